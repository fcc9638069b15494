"""What happened, appended to the lab's chain of events."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import partial
from typing import Any
from uuid import UUID

from django.db import connection
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import happened_at, now
from labweb.common.clock import told as told_by_host
from labweb.crutd import selectors
from labweb.crutd.models import Event, Ticket, Transaction
from labweb.crutd.selectors.event_chain import event_hash as event_hash
from labweb.crutd.selectors.event_chain import told_columns
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd import operations
from labweb.domain.crutd.settlement import Change
from labweb.domain.errors import DefinitionError, StateError
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab

# Written out: they are on the way of every operation of the lab.
_END = "SELECT seq, hash FROM crutd_eventhead WHERE lab_id = %s FOR NO KEY UPDATE"

_COLUMNS = (
    "lab_id", "seq", "at", "received_at", "uncertainty_s", "is_bounded", "transaction_id", "name",
    "state", "prev_hash", "hash",
)  # fmt: skip

_APPEND = """
WITH appended AS (
    INSERT INTO crutd_event
        (lab_id, seq, at, received_at, uncertainty_s, is_bounded, transaction_id, name, state, body,
        prev_hash, hash)
    VALUES (%(lab_id)s, %(seq)s, %(at)s, %(received_at)s, %(uncertainty_s)s, %(is_bounded)s,
        %(transaction_id)s, %(name)s, %(state)s, %(body)s::jsonb, %(prev_hash)s, %(hash)s)
    RETURNING id
), concerned AS (
    INSERT INTO crutd_eventsubject (event_id, resource_id, role)
    SELECT appended.id, subject.resource_id, subject.role
    FROM appended, unnest(%(resources)s::uuid[], %(roles)s::text[]) AS subject(resource_id, role)
)
SELECT id FROM appended
"""


def record(
    row: Transaction,
    change: Change,
    *,
    revs: Mapping[UUID, int] | None = None,
    base: str = "",
    along: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
    told: Mapping[str, Mapping[str, Any] | None] | None = None,
) -> Event:
    """Append the event of a settled transaction to the lab's chain and announce it.

    Args:
        row: The transaction, as it stands now.
        change: What was written.
        revs: Counters that the edge reported; None where the server raised them by one.
        base: For an import, the digest of the lab file that events are replayed on.
        told: What else stands in it by name: for a Read `reading`, what the device said; where a
            doubt ends with it `resolution`, what a person answered.
        along: What was created with it: for labware and devices `parts`, parents first; for
            devices `links`, the connections between their parts.
    """
    seq, prev = _end_of_chain(row.lab_id)
    body: dict[str, Any] = {
        "operation": row.operation,
        "change": change.to_json(),
        "verification": row.verification,
        "code": row.code,
        "message": row.message,
        "job_id": None if row.job_id is None else str(row.job_id),
        "actor_id": None if row.actor_id is None else str(row.actor_id),
    }
    if revs:
        body["revs"] = {str(resource_id): rev for resource_id, rev in sorted(revs.items())}
    if base:
        body["base"] = base
    for name, facts in (told or {}).items():
        if facts:
            body[name] = dict(facts)
    for name, rows in (along or {}).items():
        if rows:
            body[name] = [dict(row) for row in rows]
    at, of_host = happened_at(), told_of_host(now())
    if of_host:
        body["told"] = of_host
    event = Event(
        lab_id=row.lab_id,
        seq=seq + 1,
        at=at,
        **told_columns(body),
        transaction=row,
        name=row.name,
        state=row.state,
        body=body,
        prev_hash=prev,
        hash=event_hash(prev, seq + 1, at.isoformat(), str(row.id), body),
    )
    _append(event, operations.subjects_of(operations.from_json(row.operation)))
    on_commit(partial(feed.publish, "events", {"seq": event.seq, "job_id": body["job_id"]}))
    return event


def told_of_host(received_at: datetime) -> dict[str, Any]:
    """Return what stands in an event beside its time, where a host told it; else nothing."""
    found = told_by_host()
    if found is None:
        return {}
    return {
        "received_at": received_at.isoformat(),
        "uncertainty_s": found.uncertainty_s,
        "is_bounded": found.is_bounded,
    }


def _end_of_chain(lab_id: UUID) -> tuple[int, str]:
    """Lock the end of a lab's chain until the next event is there, and return it."""
    with connection.cursor() as cursor:
        cursor.execute(_END, [lab_id])
        seq, last_hash = cursor.fetchone()
    return seq, last_hash


def wait_for_others(lab: Lab) -> None:
    """Let nobody else record anything in a lab until this block ends.

    Who asks whether an id, a key or a delivery is new asks after this: of two who bring the
    same one at the same time, the second sees the first.
    """
    _end_of_chain(lab.id)


def _append(event: Event, subjects: Sequence[tuple[UUID, str]]) -> None:
    """Insert an event and what it concerns, in one statement."""
    values: dict[str, Any] = {name: getattr(event, name) for name in _COLUMNS} | {
        "body": json.dumps(event.body)
    }
    values["resources"] = [resource_id for resource_id, _ in subjects]
    values["roles"] = [role for _, role in subjects]
    with connection.cursor() as cursor:
        cursor.execute(_APPEND, values)
        (event.id,) = cursor.fetchone()


def open_ticket(lab: Lab, code: str, message: str, detail: Mapping[str, Any]) -> Ticket:
    """Ask a person to look at a contradiction."""
    ticket = Ticket.objects.create(
        lab=lab, code=code, message=message, detail=dict(detail), opened_at=now()
    )
    on_commit(partial(feed.publish, "lab", {"ticket_id": str(ticket.id)}))
    return ticket


@atomic
def close_ticket(ticket_id: UUID, *, actor: User, reason: str) -> Ticket:
    """Close a ticket that a person has looked into.

    Raises:
        NotFoundError: There is no such ticket.
        ForbiddenError: The actor may not resolve on all that the ticket concerns.
        DefinitionError: The reason is empty.
        StateError: The ticket is closed.

    Effect:
        None on matter and on the record: quarantines end by taking stock. The audit keeps
        the reason.
    """
    ticket = selectors.ticket_for_update(ticket_id)
    resource_selectors.require(actor, Permission.RESOLVE, selectors.concerns([ticket])[ticket.id])
    if not reason.strip():
        raise DefinitionError(
            "say what you found: the reason is empty", code="ticket.reason_missing"
        )
    if ticket.closed_at is not None:
        raise StateError("this ticket is closed", code="ticket.closed")
    ticket.closed_at, ticket.closed_by = now(), actor
    ticket.save(update_fields=["closed_at", "closed_by"])
    account_services.write_audit(
        "ticket.close",
        str(ticket.id),
        actor=actor,
        reason=reason.strip(),
        detail={"code": ticket.code},
    )
    on_commit(partial(feed.publish, "lab", {"ticket_id": str(ticket.id)}))
    return ticket
