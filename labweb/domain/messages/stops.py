"""Frames of the uplink by which the lab is stopped."""

from __future__ import annotations

from uuid import UUID

import msgspec


class StopLabFrame(msgspec.Struct, frozen=True, tag="stop_lab", tag_field="t", kw_only=True):
    """Software stop: halt every device now and latch."""

    stop_id: UUID
    issued_by: str


class StopAcknowledged(
    msgspec.Struct, frozen=True, tag="stop_acknowledged", tag_field="t", kw_only=True
):
    """The latch is on disk and every line was told to halt."""

    stop_id: UUID
    lines: list[str]
