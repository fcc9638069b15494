"""What completed actions have left standing on the devices of a host, as its journal keeps it.

A line is added with the end of an action, and taken away by what ends it, by a halt of the device,
and once it is seen to be gone. So it survives a restart of the host, and a loss is told once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.canonical_json import canonical
from labweb.domain.runs.host_journal.journal_rows import JournalWrite

KEY = "stands"


class StandingSetpoint(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that an action left set."""

    action_id: UUID
    action: str
    args: dict[str, Any]


def read_stands(meta: Mapping[str, str]) -> dict[UUID, dict[str, StandingSetpoint]]:
    """Return what stands, by device and sort, from a host's remembered values."""
    text = meta.get(KEY, "{}")
    return msgspec.json.decode(text, type=dict[UUID, dict[str, StandingSetpoint]])


def put_stands(
    tx: JournalWrite, device_id: UUID, sort: str, stands: StandingSetpoint | None
) -> None:
    """Remember what stands of one sort; None: nothing that is known."""
    known = read_stands(tx.meta())
    of_device = known.pop(device_id, {})
    if of_device.get(sort) == stands:
        return
    of_device.pop(sort, None)
    if stands is not None:
        of_device[sort] = stands
    _write(tx, {**known, device_id: of_device} if of_device else known)


def clear_stands(tx: JournalWrite, device_id: UUID) -> None:
    """Forget what stood on a device: it was halted."""
    known = read_stands(tx.meta())
    if known.pop(device_id, None) is not None:
        _write(tx, known)


def _write(tx: JournalWrite, known: Mapping[UUID, Mapping[str, StandingSetpoint]]) -> None:
    plain = {str(device_id): of_device for device_id, of_device in known.items()}
    tx.set_meta(KEY, canonical(plain).decode() if plain else None)
