"""Events of an edge host: gap-free, chained by hash, acknowledged by the server."""

from __future__ import annotations

import hashlib
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.canonical_json import canonical

MAX_EVENTS_PER_FRAME = 500


class EdgeEvent(msgspec.Struct, frozen=True, kw_only=True):
    """One fact of an edge host: gap-free by `seq`, chained by `hash`."""

    seq: int
    prev_hash: str
    hash: str
    kind: str
    """accepted, refused, rejected, stopped, started, actuated, complete, aborted, in_doubt,
    resolved, boot, armed, link_lost, stop_latched, stop_reset, released, kept, received,
    driver_ready, driver_refused, driver_serving, countersigned, head_refused."""

    action_id: UUID | None
    at_s: float
    """Clock of the host that people and programs set: what it showed."""

    body: dict[str, Any]
    mono_s: float | None = None
    """Clock of the host that only runs; None: an older program wrote the event."""

    boot_id: str = ""
    """Start of the machine from which that clock runs."""

    happened_s: float | None = None
    """The moment by the server's clock, as the host knows when it tells; no part of the hash."""

    uncertainty_s: float | None = None
    """At most so far is `happened_s` wrong; None: the host has not measured."""


class EventsFrame(msgspec.Struct, frozen=True, tag="events", tag_field="t", kw_only=True):
    """Events from `acked_seq + 1` on, without a gap."""

    epoch: int
    events: list[EdgeEvent]


class Ack(msgspec.Struct, frozen=True, tag="ack", tag_field="t", kw_only=True):
    """Everything up to `seq` is committed on the server."""

    seq: int


def event_hash(
    journal_id: UUID, prev_hash: str, event: EdgeEvent, body: bytes | None = None
) -> str:
    """Return the SHA-256 that binds an event to its journal and all before it.

    `body` is the event's body as canonical text; None renders it. An event of a program that
    read one clock alone is bound as that program bound it.
    """
    fields = {
        "journal_id": str(journal_id),
        "prev": prev_hash,
        "seq": event.seq,
        "kind": event.kind,
        "action_id": None if event.action_id is None else str(event.action_id),
        "at_s": event.at_s,
        "body": event.body if body is None else msgspec.Raw(body),
    }
    if event.boot_id:
        fields["clock"] = {"boot_id": event.boot_id, "mono_s": event.mono_s}
    return hashlib.sha256(canonical(fields)).hexdigest()
