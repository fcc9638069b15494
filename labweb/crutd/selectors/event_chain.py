"""Does the chain of events hold? The first row that was edited, deleted or reordered."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any

import msgspec

from labweb.accounts.selectors.hash_chains import EVENTS, first_broken_head
from labweb.crutd.models import Event, EventHead, EventSubject, LabBase
from labweb.domain.canonical_json import canonical
from labweb.domain.crutd import operations
from labweb.domain.errors import Finding
from labweb.domain.messages.chain_heads import Countersigned
from labweb.resources.selectors import Lab

_AT_ONCE = 2000


def event_hash(prev: str, seq: int, at: str, transaction_id: str, body: Mapping[str, Any]) -> str:
    """Return the SHA-256 that binds an event to all before it in its lab."""
    fields = {"prev": prev, "seq": seq, "at": at, "transaction": transaction_id, "body": body}
    return hashlib.sha256(canonical(fields)).hexdigest()


def told_columns(body: Mapping[str, Any]) -> dict[str, Any]:
    """Return the columns of an event that its body tells: when it was heard of, and how sure."""
    told = body.get("told") or {}
    at = told.get("received_at")
    return {
        "received_at": None if at is None else datetime.fromisoformat(at),
        "uncertainty_s": told.get("uncertainty_s"),
        "is_bounded": told.get("is_bounded", False),
    }


def first_broken_event(lab: Lab) -> Finding | None:
    """Return the first event that is not as it was written; None: the chain is whole."""
    head = EventHead.objects.filter(lab=lab).first()
    if head is None:
        return Finding("events.no_head", "nothing says where the chain ends", str(lab.id))
    seq, prev = 0, ""
    for batch in _batches(lab):
        subjects = _subjects(batch)
        for event in batch:
            broken = _broken(event, seq + 1, prev, subjects.get(event.id, set()))
            if broken is not None:
                return broken
            seq, prev = event.seq, event.hash
    if (seq, prev) != (head.seq, head.hash):
        text = f"event {seq} is the last one, and event {head.seq} was: the end was cut off"
        return Finding("events.truncated", text, str(seq + 1), {"seq": seq + 1})
    return _broken_base(lab)


def chain_of(lab: Lab) -> str:
    """Return the name under which heads of a lab's events are signed."""
    return f"{EVENTS}{lab.pk}"


def end_of_events(lab: Lab) -> tuple[int, str] | None:
    """Return number and hash of a lab's last event; None: there is none."""
    row = Event.objects.filter(lab=lab).order_by("-seq").values_list("seq", "hash").first()
    return None if row is None else (row[0], row[1])


def first_broken_signed_head(lab: Lab, kept: Sequence[Countersigned] = ()) -> Finding | None:
    """Return the first signed head that a lab's events do not fit, or None.

    Args:
        lab: Whose.
        kept: Heads that were kept outside of this server.
    """
    rows = Event.objects.filter(lab=lab)
    return first_broken_head(
        chain_of(lab),
        lambda seq: rows.filter(seq=seq).values_list("hash", flat=True).first(),
        kept,
    )


def _batches(lab: Lab, up_to: int | None = None) -> Iterator[list[Event]]:
    """Yield the events of a lab in order, a page at a time, however many there are."""
    rows = Event.objects.filter(lab=lab).order_by("seq")
    if up_to is not None:
        rows = rows.filter(seq__lte=up_to)
    batch = list(rows[:_AT_ONCE])
    while batch:
        yield batch
        batch = list(rows.filter(seq__gt=batch[-1].seq)[:_AT_ONCE])


def events_in_order(lab: Lab, *, up_to: int | None = None) -> Iterator[Event]:
    """Yield the events of a lab, the first one first, to the last or to this number."""
    for batch in _batches(lab, up_to):
        yield from batch


def _subjects(batch: list[Event]) -> dict[int, set[tuple[str, str]]]:
    found: dict[int, set[tuple[str, str]]] = {}
    rows = EventSubject.objects.filter(event_id__in=[event.id for event in batch])
    for event_id, resource_id, role in rows.values_list("event_id", "resource_id", "role"):
        found.setdefault(event_id, set()).add((str(resource_id), role))
    return found


def broken_link(event: Event, seq: int, prev: str) -> Finding | None:
    """Say how an event does not follow the one before it; None: it does."""
    row = str(event.id)
    context = {"seq": event.seq, "id": event.id, "expected_seq": seq}
    if event.seq != seq:
        text = f"event {seq} is missing: event {event.seq} follows event {seq - 1}"
        return Finding("events.missing", text, str(seq), context)
    if event.prev_hash != prev:
        text = f"event {seq} (row {row}) does not follow event {seq - 1}: rows were exchanged"
        return Finding("events.reordered", text, str(seq), context)
    at = event.at.isoformat()
    own = event_hash(event.prev_hash, event.seq, at, str(event.transaction_id), event.body)
    if own != event.hash:
        text = f"event {seq} (row {row}) was edited: it does not fit its own hash"
        return Finding("events.edited", text, str(seq), context)
    return None


def _broken(event: Event, seq: int, prev: str, subjects: set[tuple[str, str]]) -> Finding | None:
    broken = broken_link(event, seq, prev)
    if broken is None and not _columns_fit(event, subjects):
        text = f"event {seq} (row {event.id}): columns or subjects are not what its body says"
        context = {"seq": event.seq, "id": event.id, "expected_seq": seq}
        return Finding("events.columns", text, str(seq), context)
    return broken


def _columns_fit(event: Event, subjects: set[tuple[str, str]]) -> bool:
    try:
        operation = operations.from_json(event.body["operation"])
        state = event.body["change"]["state"]
        told = told_columns(event.body)
    except (KeyError, TypeError, ValueError, AttributeError, msgspec.ValidationError):
        return False
    if any(getattr(event, column) != value for column, value in told.items()):
        return False
    wanted = {(str(resource_id), role) for resource_id, role in operations.subjects_of(operation)}
    name = operations.name_of(operation).value
    return (event.name, event.state) == (name, state) and subjects == wanted


def _broken_base(lab: Lab) -> Finding | None:
    """Compare the imported lab with the digest in the first event."""
    first = Event.objects.filter(lab=lab, seq=1).first()
    told = None if first is None else first.body.get("base")
    base = LabBase.objects.filter(lab=lab).first()
    if told is None and base is None:
        return None
    try:
        found = None if base is None else hashlib.sha256(zlib.decompress(base.document)).hexdigest()
    except zlib.error:
        found = None
    if base is None or found != told or base.sha256 != told:
        text = "the imported lab that events are replayed on was edited or deleted"
        return Finding("events.base", text, str(lab.id), {"sha256": told})
    return None
