"""The one write path: lock, settle, resolve. Nothing else changes a resource."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from uuid import UUID

from django.db.transaction import atomic

from labweb.common.clock import happened_at
from labweb.crutd import selectors
from labweb.crutd.models import Entry, ResourceLock, Transaction
from labweb.crutd.selectors.archive import with_former_place
from labweb.crutd.selectors.condition_facts import facts_for, holders
from labweb.crutd.selectors.placement import with_place
from labweb.crutd.services.events import open_ticket, record
from labweb.crutd.services.ledger_posting import close_transaction, post, reserve
from labweb.crutd.services.locks import reserved_findings, roomy_of
from labweb.crutd.services.run_holds import Asker, held_findings
from labweb.crutd.services.transaction_opening import lock_and_read
from labweb.domain.crutd import operations, transaction_states
from labweb.domain.crutd import settlement as decide
from labweb.domain.crutd.ledger import vessels_of
from labweb.domain.crutd.reserved_amounts import Reservation, reservations
from labweb.domain.crutd.settlement import Change, Outcome, OutcomeKind, ResourceState
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import Finding, PreconditionError, StateError
from labweb.domain.runs.host_actions.host_batch import heirs
from labweb.resources import selectors as resource_selectors
from labweb.resources import services as resource_services
from labweb.resources.selectors import Lab


def check_operation(
    operation: operations.Operation, *, lab: Lab, actor_id: UUID | None, run_id: UUID | None = None
) -> list[Finding]:
    """List all that speaks against an operation now, who uses or has reserved things included.

    What `run_id` holds does not speak against it.
    """
    operation = with_former_place(operation)
    ids = operations.touched_ids(operation)
    found = resource_selectors.rows(ids)
    states = with_place(operation, selectors.snapshot(found))
    facts = replace(facts_for(operation, lab, states), held=holders(operation))
    rows = {row.id: row for row in found}
    reserved = reserved_findings(ids, actor_id, roomy_of(operation, rows))
    held = held_findings(operation, ids, Asker(actor_id=actor_id, run_id=run_id))
    return [*_empty_words(operation), *decide.check(operation, states, facts), *reserved, *held]


def _empty_words(operation: operations.Operation) -> list[Finding]:
    """Refuse to write down by hand that a thing was carried to where it stands.

    Between two hosts such a transfer means something: it changes hands, and nothing moves.
    """
    if not isinstance(operation, operations.TransferResource):
        return []
    if operation.from_id != operation.to_id:
        return []
    text = "it stands there already: nothing is carried"
    return [Finding("crutd.there_already", text, str(operation.resource_id))]


def _check_in_service(operation: operations.Operation) -> None:
    """Refuse what a second press asks for: a thing in the Archive goes there no more."""
    if not isinstance(operation, operations.Delete):
        return
    found = selectors.snapshot(resource_selectors.rows([operation.resource_id]))
    for state in found.values():
        if state.is_archived:
            text = f"{state.name} is in the Archive already: nothing was done"
            raise StateError(text, code="crutd.archived")


@atomic
def advance(transaction_id: UUID, state: TransactionState) -> None:
    """Move a live transaction to EXECUTING or CONFIRMING.

    Raises:
        StateError: The table does not list the step.
    """
    row = selectors.transaction_for_update(transaction_id)
    _take_turn(row)
    transaction_states.check_step(TransactionState(row.state), state)
    row.state = state.value
    row.save(update_fields=["state"])


def _take_turn(row: Transaction) -> None:
    """Reserve what a waiting member of a batch moves: its turn has come."""
    if row.state == TransactionState.VALIDATED.value and row.batch_id is not None:
        row.state = TransactionState.LOCKED.value
        row.save(update_fields=["state"])
        reserve(row, reservations(operations.from_json(row.operation)))


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
    closes: frozenset[UUID] = frozenset()
    """What a person has to look at first, however the transaction ends."""

    parts: Sequence[Mapping[str, Any]] = ()
    """What was created along with a piece of labware, or a device."""

    links: Sequence[Mapping[str, Any]] = ()
    """Connections that were created along with a device."""

    resolution: Mapping[str, Any] = field(default_factory=dict)
    """What a person answered about a doubt that this ends: `answer`, `moved_nl`, `note`, `by_id`,
    `despite_reading`."""


@atomic
def settle(transaction_id: UUID, settlement: Settlement) -> Change:
    """Decide again what the edge decided, write it down, and release the locks.

    A difference between the two decisions opens a ticket and quarantines the resources;
    the record then follows the server's reading of the same facts.

    Raises:
        StateError: The transaction is final already, or it is in doubt and the answer
            contradicts the record (`crutd.contradiction`). Nothing was written.

    Effect:
        Posts what moved to the ledger. UNKNOWN posts nothing and keeps every lock.
    """
    row = selectors.transaction_for_update(transaction_id)
    operation = operations.from_json(row.operation)
    rows = resource_selectors.rows_for_update(operations.touched_ids(operation))
    states = selectors.snapshot_in_place(list(rows.values()))
    return _settle(row, operation, states, settlement)


def _settle(
    row: Transaction,
    operation: operations.Operation,
    states: Mapping[UUID, ResourceState],
    settlement: Settlement,
) -> Change:
    """Settle as above, with everything locked."""
    change = _decide(row, operation, states, settlement)
    if change.state is TransactionState.QUARANTINED and row.state == TransactionState.VALIDATED:
        # It waited for its turn, and nobody knows whether that came: nothing was reserved.
        row.state = TransactionState.LOCKED.value
        row.save(update_fields=["state"])
    transaction_states.check_step(TransactionState(row.state), change.state)
    change = _with_released(row, change, settlement)
    if settlement.closes:
        change = replace(change, quarantined=change.quarantined | settlement.closes)
    _apply(row, operation, change, settlement)
    _close(row, change, settlement)
    record(
        row,
        change,
        revs=settlement.revs,
        along={"parts": settlement.parts, "links": settlement.links},
        told={
            "reading": settlement.outcome.data if isinstance(operation, operations.Read) else None,
            "resolution": settlement.resolution,
        },
    )
    return change


def _decide(
    row: Transaction,
    operation: operations.Operation,
    states: Mapping[UUID, ResourceState],
    settlement: Settlement,
) -> Change:
    try:
        change = decide.settle(operation, states, settlement.outcome)
    except StateError as error:
        if row.state == TransactionState.QUARANTINED.value:
            # A person's answer: it is refused, and the doubt stays as it is.
            raise
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
        change = replace(change, quarantined=frozenset(states))
    return change


def _with_released(row: Transaction, change: Change, settlement: Settlement) -> Change:
    """Add the resources whose quarantine ends with their transaction's doubt."""
    is_settled = (
        row.state == TransactionState.QUARANTINED.value and change.state in transaction_states.FINAL
    )
    if not is_settled or settlement.keep_quarantined:
        return change
    closed = resource_selectors.quarantined_by(row.id)
    return replace(change, released=(change.released | set(closed)) - change.quarantined)


def _apply(
    row: Transaction, operation: operations.Operation, change: Change, settlement: Settlement
) -> None:
    if change.postings:
        _create_lots(operation, row)
    for create in change.created:
        resource_services.create_resource(create, row.lab)
    for resource_id, data in change.data.items():
        resource_services.update_data(resource_id, data)
    _place(change)
    if isinstance(operation, operations.Refit) and change.state is TransactionState.COMMITTED:
        resource_services.rejoin(operation, row.lab)
    if isinstance(operation, operations.Disconnect) and change.state is TransactionState.COMMITTED:
        resource_services.part([operation.connection_id])
    if change.released:
        resource_services.release(change.released)
    if change.quarantined:
        resource_services.quarantine(change.quarantined, row.id)
    has_ended = change.state in transaction_states.FINAL
    post(row, change.postings, _reserved(row, operation) if has_ended else ())
    if settlement.revs:
        resource_services.set_revs(settlement.revs)
    else:
        resource_services.raise_revs(changed_ids(change))


def _place(change: Change) -> None:
    """Write where things stand, in or out of service, and what parts of devices are."""
    for resource_id, config in change.configs.items():
        resource_services.set_config(resource_id, config)
    for resource_id, parent_id in change.moves.items():
        resource_services.move(resource_id, parent_id)
    for resource_id, pose in change.poses.items():
        resource_services.set_pose(resource_id, pose)
    if change.archived:
        resource_services.archive(change.archived)
    if change.restored:
        resource_services.restore(change.restored)


def _reserved(row: Transaction, operation: operations.Operation) -> Sequence[Reservation]:
    """Return what a transaction has reserved; a member of a batch may not have come to it."""
    wanted = reservations(operation)
    if row.batch_id is None or not wanted:
        return wanted
    is_promised = Entry.objects.filter(transaction=row, state=Entry.State.PENDING).exists()
    return wanted if is_promised else ()


def _create_lots(operation: operations.Operation, row: Transaction) -> None:
    """Write the lots that a delivery or a reaction brings."""
    if isinstance(operation, operations.Receive):
        resource_services.create_lot(operation, row.lab)
    elif isinstance(operation, operations.React):
        resource_services.create_products(operation, row.lab)


def changed_ids(change: Change) -> set[UUID]:
    """Return the resources whose state a change alters."""
    vessels = vessels_of(change.postings)
    placed = set(change.moves) | change.archived | change.restored | set(change.configs)
    return vessels | set(change.data) | placed | change.released


def _close(row: Transaction, change: Change, settlement: Settlement) -> None:
    row.state = change.state.value
    row.change = change.to_json()
    row.verification = settlement.verification
    row.conditions = [*row.conditions, *(dict(c) for c in settlement.conditions)]
    row.code, row.message = settlement.code, settlement.message
    if change.state in transaction_states.FINAL:
        row.settled_at = happened_at()
        _pass_on(row)
    close_transaction(row)


def _pass_on(row: Transaction) -> None:
    """Hand the locks that open members of the batch need on to them."""
    if row.batch_id is None:
        return
    members = Transaction.objects.filter(batch_id=row.batch_id).exclude(pk=row.pk)
    members = members.exclude(state__in=[state.value for state in transaction_states.FINAL])
    claims = {
        member.pk: {UUID(node) for node in member.claims} for member in members.order_by("pk")
    }
    held = ResourceLock.objects.filter(transaction=row, released_at__isnull=True)
    found = heirs(list(held.values_list("resource_id", flat=True)), claims)
    for resource_id, heir in found.items():
        if heir is not None:
            held.filter(resource_id=resource_id).update(transaction_id=heir)


@atomic
def discard(transaction_id: UUID, settlement: Settlement) -> None:
    """Give a transaction in doubt up: nothing is posted, its resources stay quarantined.

    Effect:
        What the vessels hold stays unknown until a person takes stock of them, and what a
        device is set to until it is set anew.
    """
    row = selectors.transaction_for_update(transaction_id)
    transaction_states.check_step(TransactionState(row.state), TransactionState.ROLLED_BACK)
    operation = operations.from_json(row.operation)
    change = Change(state=TransactionState.ROLLED_BACK, data=decide.given_up(operation))
    # The host has raised the revisions by closing the vessels anew; what it is sent next must
    # not look older than what it knows.
    _apply(row, operation, change, settlement)
    # Another action in doubt may have closed them first: its answer must not open them.
    resource_services.close_for(operations.touched_ids(operation), row.id)
    _close(row, change, settlement)
    record(row, change, revs=settlement.revs, told={"resolution": settlement.resolution})


@atomic
def carry_out(
    operation: operations.Operation,
    *,
    lab: Lab,
    actor_id: UUID,
    targets: Collection[UUID] = (),
    note: str = "",
    run_id: UUID | None = None,
) -> Transaction:
    """Do a purely digital or hand-made operation at once: lock, settle as done, release.

    Args:
        operation: What was done.
        lab: Where.
        actor_id: Who did it.
        targets: What was used for it beside.
        note: What they say of it.
        run_id: The run for which it was done; None: for none.

    Raises:
        LockedError: A resource is in use, or a run holds it. Nothing was written.
        PreconditionError: A precondition fails; findings list each.
        StateError: What is to go to the Archive is there. Nothing was written.

    Effect:
        Records what the person did or will have done; moves nothing by itself.
    """
    empty = _empty_words(operation)
    if empty:
        raise PreconditionError(empty[0].message, code=empty[0].code, findings=empty)
    _check_in_service(operation)
    operation = with_former_place(operation)
    asker = Asker(actor_id=actor_id, run_id=run_id)
    row, _, states = lock_and_read(operation, lab, targets, asker=asker)
    outcome = Outcome(kind=OutcomeKind.DONE)
    settlement = Settlement(
        outcome=outcome, verification="assumed", actor_id=actor_id, message=note
    )
    _settle(row, operation, states, settlement)
    return row
