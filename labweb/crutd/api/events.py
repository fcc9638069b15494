"""Events as answers show them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any
from uuid import UUID

from labweb.crutd import selectors
from labweb.crutd.answers import DoubtEnd, EventRow, EventSubjectRow
from labweb.crutd.models import Event, EventSubject
from labweb.crutd.selectors.doubt_resolutions import ends_of_doubts
from labweb.domain.crutd.operations import OperationName
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.units import render_volume

_ELSEWHERE = "elsewhere"
"""Stands for the name of what the caller may not know of."""

_MOVES = frozenset({"transfer_liquid", "transfer_mass"})


def event_rows(events: list[Event], seen: Collection[UUID] | None = None) -> list[EventRow]:
    """Return events with the resources they concern; four queries at most.

    One that left a doubt has in `resolved` how that ended, once it has.

    Args:
        events: What to tell of.
        seen: Resources whose names may be told; None tells all.
    """
    subjects = selectors.subjects_of(event.id for event in events)
    for rows in subjects.values():
        for subject in rows:
            if seen is not None and subject.resource_id not in seen:
                subject.resource.name = _ELSEWHERE
    ends = ends_of_doubts(events)
    return [_event(event, subjects.get(event.id, []), ends.get(event.id)) for event in events]


def _event(event: Event, subjects: list[EventSubject], end: DoubtEnd | None) -> EventRow:
    operation = event.body.get("operation", {})
    change = event.body.get("change") or {}
    postings = change.get("postings", [])
    amount = sum(posting["amount_nl"] for posting in postings) or operation.get("amount_nl")
    mass = sum(posting.get("amount_ug", 0) for posting in postings) or operation.get("amount_ug")
    job_id = event.body.get("job_id")
    return EventRow(
        seq=event.seq,
        at=event.at,
        received_at=event.received_at or event.at,
        uncertainty_s=event.uncertainty_s,
        is_bounded=event.is_bounded,
        operation=OperationName(event.name),
        state=TransactionState(event.state),
        verification=event.body.get("verification", ""),
        subjects=[
            EventSubjectRow(id=s.resource_id, name=s.resource.name, role=s.role) for s in subjects
        ],
        amount_nl=amount if operation.get("op") == "transfer_liquid" else None,
        amount_ug=mass if operation.get("op") in _MOVES and mass else None,
        summary=_summary(
            operation, change, subjects, (amount or 0, mass or 0), event.body.get("reading", {})
        ),
        job_id=None if job_id is None else UUID(job_id),
        code=event.body.get("code", ""),
        message=event.body.get("message", ""),
        transaction_id=event.transaction_id,
        resolved=end,
    )


def _summary(
    operation: Mapping[str, Any],
    change: Mapping[str, Any],
    subjects: list[EventSubject],
    amounts: tuple[int, int],
    reading: Mapping[str, Any],
) -> str:
    names = {s.role: s.resource.name for s in subjects}
    text = _amounts(*amounts)
    match operation.get("op"):
        case "transfer_liquid" | "transfer_mass":
            return f"{names.get('source')} → {names.get('target')}, {text}"
        case "transfer_resource" if operation["from_id"] == operation["to_id"]:
            return f"{names.get('subject')}: handed to another host at {names.get('target')}"
        case "disconnect":
            return f"{names.get('source')} and {names.get('target')} taken apart"
        case "transfer_resource" | "restore":
            return f"{names.get('subject')}: {names.get('source')} → {names.get('target')}"
        case "update":
            return f"{names.get('subject')}: {_updated(operation, change)}"
        case "read":
            if not reading:
                return ", ".join(operation.get("statuses", [])) or "reading"
            facts = ", ".join(f"{key} {value}" for key, value in sorted(reading.items()))
            return f"{names.get('subject')}: {facts}"
        case "create":
            received = f"received {text} in all" if any(amounts) else "added to the lab"
            return f"{names.get('subject')}: {received}"
        case _:
            return _booked(operation, names, text)


def _updated(operation: Mapping[str, Any], change: Mapping[str, Any]) -> str:
    """Say what is set now; of an update that was given up, what nobody knows any more."""
    data = next(iter((change.get("data") or {}).values()), None)
    if data and change.get("state") == TransactionState.ROLLED_BACK.value:
        return ", ".join(f"{key} unknown" for key in sorted(data))
    data = operation.get("data", {}) if data is None else data
    return ", ".join(f"{key} {value}" for key, value in sorted(data.items()))


def _booked(operation: Mapping[str, Any], names: Mapping[str, str], text: str) -> str:
    """Say what entered the lab, left it, or became something else."""
    subject = names.get("subject", "")
    match operation.get("op"):
        case "receive":
            return f"{operation.get('number') or operation.get('key')}: received {text}"
        case "correct":
            return f"{subject}: {text}, {operation['account']}: {operation['reason']}"
        case "react":
            made = ", ".join(product["key"] for product in operation["products"])
            return f"{subject}: made {made}; {operation['reason']}"
        case "dispose":
            return f"{names.get('source')}: {text} to waste"
        case "refit":
            return f"{operation['digest'][:8]}: {_refitted(operation)}"
        case _:
            return subject


def _refitted(operation: Mapping[str, Any]) -> str:
    """Say how many parts of a device came, went and became otherwise."""
    came = len(operation["added"]) + len(operation["back"])
    told = (
        (came, "came"),
        (len(operation["gone"]), "went"),
        (len(operation["configs"]), "changed"),
    )
    return ", ".join(f"{count} {verb}" for count, verb in told if count) or "roles changed"


def _amounts(amount_nl: int, amount_ug: int) -> str:
    if amount_ug and amount_nl:
        return f"{render_volume(amount_nl)} and {amount_ug / 1000:g} mg"
    return f"{amount_ug / 1000:g} mg" if amount_ug else render_volume(amount_nl)
