"""The one write path: lock, settle, resolve. Nothing else changes a resource."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any
from uuid import UUID

from django.db import OperationalError
from django.db.models import F, Max
from django.db.transaction import atomic, on_commit

from labweb.common import feed
from labweb.common.clock import now
from labweb.crutd import selectors
from labweb.crutd.models import (
    Entry,
    Event,
    EventSubject,
    Holding,
    ResourceLock,
    Ticket,
    Transaction,
)
from labweb.domain.crutd import decide, lifecycle, operations
from labweb.domain.crutd.decide import Change, Outcome, OutcomeKind
from labweb.domain.crutd.lifecycle import TransactionState
from labweb.domain.errors import Finding, LockedError, PreconditionError, StateError
from labweb.domain.messages import canonical
from labweb.domain.runs.locks import conflicts, lock_set
from labweb.resources import selectors as resource_selectors
from labweb.resources import services as resource_services
from labweb.resources.selectors import Lab, Resource


@atomic
def lock_operation(
    operation: operations.Operation,
    *,
    lab: Lab,
    targets: Collection[UUID],
    actor_id: UUID | None,
    job_id: UUID | None = None,
) -> Transaction:
    """Take the whole lock set of an operation at once, and write it down as LOCKED.

    Raises:
        LockedError: Somebody else uses a resource. Nothing was written.
        PreconditionError: The operation breaks a precondition now; findings list each.

    Effect:
        None on matter. Locks hold until the transaction is settled; they never expire.
    """
    touched = set(operations.touched_ids(operation))
    wanted_ids = touched & _resource_ids(touched) | set(targets)
    rows = _rows(wanted_ids)
    _check_free(rows, wanted_ids)
    findings = _check_operation(operation, rows)
    if findings:
        raise PreconditionError(findings[0].message, code=findings[0].code, findings=findings)
    row = Transaction.objects.create(
        lab=lab,
        state=TransactionState.LOCKED.value,
        name=operations.name_of(operation).value,
        operation=operations.to_json(operation),
        actor_id=actor_id,
        job_id=job_id,
        proposed_at=now(),
    )
    _take_locks(row, wanted_ids)
    if isinstance(operation, operations.TransferLiquid):
        Entry.objects.create(
            transaction=row,
            debit=str(operation.source_id),
            credit=str(operation.target_id),
            amount_nl=operation.amount_nl,
            state=Entry.State.PENDING,
            at=now(),
        )
    return row


def _resource_ids(ids: Collection[UUID]) -> set[UUID]:
    return set(resource_selectors.rows(ids).values_list("pk", flat=True))


def _rows(ids: Collection[UUID]) -> dict[UUID, Resource]:
    try:
        with atomic():
            return resource_selectors.rows_for_update(ids)
    except OperationalError as error:
        raise LockedError("the resources are in use this moment", code="crutd.busy") from error


def _check_free(rows: Mapping[UUID, Resource], ids: Collection[UUID]) -> None:
    above = resource_selectors.ancestors(ids)
    wanted = lock_set(ids, above)
    held = selectors.held_locks(lock.resource_id for lock in wanted)
    blocked = conflicts(wanted, [lock for lock, _ in held])
    if blocked:
        holder = next(owner for lock, owner in held if lock.resource_id == blocked[0])
        name = rows[blocked[0]].name if blocked[0] in rows else str(blocked[0])
        raise LockedError(
            f"{name} is in use",
            code="crutd.locked",
            context={"resource_id": str(blocked[0]), "transaction_id": str(holder)},
        )


def _check_operation(
    operation: operations.Operation, rows: Mapping[UUID, Resource]
) -> list[Finding]:
    if isinstance(operation, operations.Read):
        return []
    return decide.check(operation, selectors.snapshot(rows.values()))


def _take_locks(row: Transaction, ids: Collection[UUID]) -> None:
    at = now()
    locks = lock_set(ids, resource_selectors.ancestors(ids))
    ResourceLock.objects.bulk_create(
        ResourceLock(
            resource_id=lock.resource_id, mode=lock.mode.value, transaction=row, taken_at=at
        )
        for lock in locks
    )


@atomic
def advance(transaction_id: UUID, state: TransactionState) -> None:
    """Move a live transaction to EXECUTING or CONFIRMING.

    Raises:
        StateError: The table does not list the step.
    """
    row = selectors.transaction_for_update(transaction_id)
    lifecycle.check_step(TransactionState(row.state), state)
    row.state = state.value
    row.save(update_fields=["state"])


@dataclass(frozen=True, slots=True, kw_only=True)
class Settlement:
    """What is known at the end of a transaction."""

    outcome: Outcome
    verification: str = ""
    conditions: Sequence[Mapping[str, Any]] = ()
    code: str = ""
    message: str = ""
    reported_change: Mapping[str, Any] | None = None
    """What the edge decided; the server's own decision must be equal."""

    revs: Mapping[UUID, int] = field(default_factory=dict)
    """Counters the edge reported; None of ours are raised where it did."""

    actor_id: UUID | None = None
    keep_quarantined: bool = False


@atomic
def settle(transaction_id: UUID, settlement: Settlement) -> Change:
    """Decide again what the edge decided, write it down, and release the locks.

    A difference between the two decisions opens a ticket and quarantines the resources;
    the record then follows the server's reading of the same facts.

    Raises:
        StateError: The transaction is final already. Nothing was written.

    Effect:
        Posts what moved to the ledger. UNKNOWN posts nothing and keeps every lock.
    """
    row = selectors.transaction_for_update(transaction_id)
    operation = operations.from_json(row.operation)
    ids = set(operations.touched_ids(operation))
    rows = {r.id: r for r in resource_selectors.rows(ids).select_for_update()}
    change = _decide(row, operation, rows, settlement)
    lifecycle.check_step(TransactionState(row.state), change.state)
    _apply(row, change, settlement)
    _close(row, change, settlement)
    record(row, change)
    return change


def _decide(
    row: Transaction,
    operation: operations.Operation,
    rows: Mapping[UUID, Resource],
    settlement: Settlement,
) -> Change:
    try:
        change = decide.settle(operation, selectors.snapshot(rows.values()), settlement.outcome)
    except StateError as error:
        open_ticket(row.lab, error.code, error.message, {"transaction_id": str(row.id)})
        return decide.settle(operation, {}, Outcome(kind=OutcomeKind.UNKNOWN))
    reported = settlement.reported_change
    if reported is not None and dict(reported) != change.to_json():
        open_ticket(
            row.lab,
            "reconcile.drift",
            "edge and server read the same facts differently",
            {
                "transaction_id": str(row.id),
                "edge": dict(reported),
                "server": change.to_json(),
            },
        )
        resource_services.quarantine(list(rows), row.id)
    return change


def _apply(row: Transaction, change: Change, settlement: Settlement) -> None:
    for create in change.created:
        resource_services.create_resource(create, row.lab)
    for resource_id, data in change.data.items():
        resource_services.update_data(resource_id, data)
    for resource_id, parent_id in change.moves.items():
        resource_services.move(resource_id, parent_id)
    if change.archived:
        resource_services.archive(change.archived)
    if change.quarantined:
        resource_services.quarantine(change.quarantined, row.id)
    post(row, change.postings)
    if settlement.revs:
        resource_services.set_revs(settlement.revs)
    else:
        resource_services.raise_revs(changed_ids(change))


def changed_ids(change: Change) -> set[UUID]:
    """Return the resources whose state a change alters."""
    vessels = {UUID(p.debit) for p in change.postings if "-" in p.debit}
    vessels |= {UUID(p.credit) for p in change.postings if "-" in p.credit}
    return vessels | set(change.data) | set(change.moves) | set(change.archived)


def post(row: Transaction, postings: Sequence[decide.Posting]) -> None:
    """Write double entries and bring the balances of both vessels in step."""
    at = now()
    Entry.objects.bulk_create(
        Entry(
            transaction=row,
            lot_id=UUID(posting.lot),
            debit=posting.debit,
            credit=posting.credit,
            amount_nl=posting.amount_nl,
            state=Entry.State.POSTED,
            at=at,
        )
        for posting in postings
    )
    for posting in postings:
        _add(posting.debit, posting.lot, -posting.amount_nl)
        _add(posting.credit, posting.lot, posting.amount_nl)


def _add(account: str, lot: str, amount_nl: int) -> None:
    if "-" not in account:
        return
    held = Holding.objects.filter(resource_id=account, lot_id=lot)
    if not held.update(amount_nl=F("amount_nl") + amount_nl):
        Holding.objects.create(resource_id=account, lot_id=lot, amount_nl=amount_nl)


def _close(row: Transaction, change: Change, settlement: Settlement) -> None:
    was_quarantined = row.state == TransactionState.QUARANTINED.value
    row.state = change.state.value
    row.change = change.to_json()
    row.verification = settlement.verification
    row.conditions = [*row.conditions, *(dict(c) for c in settlement.conditions)]
    row.code, row.message = settlement.code, settlement.message
    if change.state in lifecycle.FINAL:
        row.settled_at = now()
        ResourceLock.objects.filter(transaction=row, released_at__isnull=True).update(
            released_at=now()
        )
        _void_pending(row)
        if was_quarantined and not settlement.keep_quarantined:
            resource_services.release(row.id)
    row.save()


def _void_pending(row: Transaction) -> None:
    for entry in Entry.objects.filter(transaction=row, state=Entry.State.PENDING):
        Entry.objects.create(
            transaction=row,
            debit=entry.debit,
            credit=entry.credit,
            amount_nl=entry.amount_nl,
            state=Entry.State.VOID,
            at=now(),
        )


@atomic
def discard(transaction_id: UUID, settlement: Settlement) -> None:
    """Give a transaction in doubt up: nothing is posted, its resources stay quarantined.

    Effect:
        What the vessels hold stays unknown until a person takes stock of them.
    """
    row = selectors.transaction_for_update(transaction_id)
    lifecycle.check_step(TransactionState(row.state), TransactionState.ROLLED_BACK)
    change = Change(state=TransactionState.ROLLED_BACK)
    # The host has raised them by closing the vessels anew; what it is sent next must not
    # look older than what it knows.
    resource_services.set_revs(settlement.revs)
    _close(row, change, settlement)
    record(row, change)


def record(row: Transaction, change: Change) -> Event:
    """Append the event of a settled transaction to the lab's chain and announce it."""
    lab = resource_selectors.lab_for_update(row.lab_id)
    last = Event.objects.filter(lab=lab).order_by("-seq").first()
    head = Event.objects.filter(lab=lab).aggregate(Max("seq"))["seq__max"] or 0
    body = {
        "operation": row.operation,
        "change": change.to_json(),
        "verification": row.verification,
        "code": row.code,
        "message": row.message,
        "job_id": None if row.job_id is None else str(row.job_id),
        "actor_id": None if row.actor_id is None else str(row.actor_id),
    }
    prev = last.hash if last is not None else ""
    at = now()
    digest = event_hash(prev, head + 1, at.isoformat(), str(row.id), body)
    event = Event.objects.create(
        lab=lab,
        seq=head + 1,
        at=at,
        transaction=row,
        name=row.name,
        state=row.state,
        body=body,
        prev_hash=prev,
        hash=digest,
    )
    _link_subjects(event, operations.from_json(row.operation))
    on_commit(partial(feed.publish, "events", {"seq": event.seq, "job_id": body["job_id"]}))
    return event


def event_hash(prev: str, seq: int, at: str, transaction_id: str, body: Mapping[str, Any]) -> str:
    """Return the SHA-256 that binds an event to all before it in its lab."""
    fields = {"prev": prev, "seq": seq, "at": at, "transaction": transaction_id, "body": body}
    return hashlib.sha256(canonical(fields)).hexdigest()


def _link_subjects(event: Event, operation: operations.Operation) -> None:
    match operation:
        case operations.TransferLiquid():
            pairs = [(operation.source_id, "source"), (operation.target_id, "target")]
        case operations.TransferResource():
            pairs = [
                (operation.resource_id, "subject"),
                (operation.from_id, "source"),
                (operation.to_id, "target"),
            ]
        case operations.Read():
            pairs = []
        case _:
            pairs = [(operation.resource_id, "subject")]
    EventSubject.objects.bulk_create(
        EventSubject(event=event, resource_id=resource_id, role=role) for resource_id, role in pairs
    )


def open_ticket(lab: Lab, code: str, message: str, detail: Mapping[str, Any]) -> Ticket:
    """Ask a person to look at a contradiction."""
    ticket = Ticket.objects.create(
        lab=lab, code=code, message=message, detail=dict(detail), opened_at=now()
    )
    on_commit(partial(feed.publish, "lab", {"ticket_id": str(ticket.id)}))
    return ticket


@atomic
def carry_out(
    operation: operations.Operation, *, lab: Lab, actor_id: UUID, targets: Collection[UUID] = ()
) -> Transaction:
    """Do a purely digital or hand-made operation at once: lock, settle as done, release.

    Raises:
        LockedError: A resource is in use. Nothing was written.
        PreconditionError: A precondition fails; findings list each.

    Effect:
        Records what the person did or will have done; moves nothing by itself.
    """
    row = lock_operation(operation, lab=lab, targets=targets, actor_id=actor_id)
    outcome = Outcome(kind=OutcomeKind.DONE)
    settle(row.id, Settlement(outcome=outcome, verification="assumed", actor_id=actor_id))
    return selectors.find_transaction(row.id)
