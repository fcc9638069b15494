"""Take what an operation needs, look whether it may be done, write that down; nothing moves."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from django.db.transaction import atomic

from labweb.common.clock import now
from labweb.common.database.prepared_queries import Question, together
from labweb.crutd import selectors
from labweb.crutd.models import Transaction
from labweb.crutd.selectors import reservations as reserved
from labweb.crutd.selectors.condition_facts import facts_for
from labweb.crutd.selectors.placement import with_place
from labweb.crutd.selectors.run_holds import asking_holds, holds_at
from labweb.crutd.services.events import wait_for_others
from labweb.crutd.services.ledger_posting import opening
from labweb.crutd.services.locks import check_free, hold_and_ask, roomy_of
from labweb.crutd.services.run_holds import Asker, check_unheld
from labweb.domain.crutd import operations, settlement
from labweb.domain.crutd.reserved_amounts import reservations
from labweb.domain.crutd.settlement import ResourceState
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import PreconditionError
from labweb.domain.runs.exclusive_use.action_locks import lock_set
from labweb.domain.runs.exclusive_use.run_holds import places_of
from labweb.resources.selectors import Above, Lab, Resource


@atomic
def lock_operation(
    operation: operations.Operation,
    *,
    lab: Lab,
    targets: Collection[UUID],
    actor_id: UUID | None,
    job_id: UUID | None = None,
    run_id: UUID | None = None,
) -> Transaction:
    """Take the whole lock set of an operation at once, and write it down as LOCKED.

    Four queries for a Transfer, however large the tree.

    Raises:
        LockedError: Somebody else uses a resource. Nothing was written.
        PreconditionError: The operation breaks a precondition now; findings list each.

    Effect:
        None on matter. Locks hold until the transaction is settled; they never expire.
    """
    asker = Asker(actor_id=actor_id, run_id=run_id)
    held = hold_to_open(operation, lab, targets, asker=asker, job_id=job_id)
    together(held.opening)
    return held.row


def lock_and_read(
    operation: operations.Operation,
    lab: Lab,
    targets: Collection[UUID],
    *,
    asker: Asker,
) -> tuple[Transaction, Mapping[UUID, Resource], Mapping[UUID, ResourceState]]:
    """Lock as above, inside a block of the caller's.

    Returns:
        The transaction, and rows and states under the locks; a Read has no need of states.
    """
    held = hold_to_open(operation, lab, targets, asker=asker)
    together(held.opening)
    return held.row, held.rows, {} if isinstance(operation, operations.Read) else held.states


@dataclass(frozen=True, slots=True)
class ToOpen:
    """A transaction whose resources are locked, free and fit, and which is not written yet."""

    row: Transaction
    rows: Mapping[UUID, Resource]
    states: Mapping[UUID, ResourceState]
    opening: Question[Any]
    """Writes it, with its locks."""


def hold_to_open(
    operation: operations.Operation,
    lab: Lab,
    targets: Collection[UUID],
    *,
    asker: Asker,
    job_id: UUID | None = None,
    granted: Collection[UUID] = (),
) -> ToOpen:
    """Do all of the above but the writing, for a caller who writes more with it; one exchange.

    Args:
        operation: What is done.
        lab: Where.
        targets: What is used for it beside.
        asker: Who does it, and for which run.
        job_id: The job that it is; None: it is none.
        granted: What the run is about to take for itself: locked against those who look.
    """
    ids = {*operations.touched_ids(operation), *targets}
    is_new = isinstance(operation, _NEW)
    found, above, (uses, holds, *holdings) = hold_and_ask(
        ids.union(granted),
        reserved.asking_uses(ids, asker.actor_id),
        asking_holds(ids),
        *([] if is_new else [selectors.HELD.asking(ids=list(ids))]),
        places=set(places_of(operation)) - set(targets) - set(granted),
    )
    rows = {node: row for node, row in found.items() if node in ids}
    wanted = lock_set(rows, above[0], roomy_of(operation, rows) - set(targets))
    check_free(rows, wanted, asker.actor_id, reserved.uses_of(uses))
    check_unheld(operation, rows, above[0], holds_at(holds), asker)
    if isinstance(operation, operations.Read):
        states, _ = selectors.states_and_lots(list(rows.values()), above, holdings[0])
    else:
        states = check_states(operation, lab, rows, above, *holdings)
    row = Transaction(
        lab=lab,
        state=TransactionState.LOCKED.value,
        name=operations.name_of(operation).value,
        operation=operations.to_json(operation),
        actor_id=asker.actor_id,
        job_id=job_id,
        proposed_at=now(),
    )
    return ToOpen(row, rows, states, opening(row, wanted, reservations(operation)))


_NEW = (
    operations.Create
    | operations.Receive
    | operations.React
    | operations.Refit
    | operations.Disconnect
)
"""What changes more than rows that are locked looks what is there one after the other."""


def check_states(
    operation: operations.Operation,
    lab: Lab,
    rows: Mapping[UUID, Resource],
    above: Above,
    holdings: Sequence[selectors.Holding] | None = None,
) -> dict[UUID, ResourceState]:
    """Check an operation on rows that are locked, and return their state; a Read needs none.

    Args:
        operation: The operation.
        lab: Where it is done.
        rows: What it touches.
        above: Everything above these.
        holdings: What they hold; None reads it.

    Raises:
        PreconditionError: The operation breaks a precondition now; findings list each.
    """
    if isinstance(operation, operations.Read):
        return {}
    if isinstance(operation, _NEW):
        wait_for_others(lab)
    own = list(rows.values())
    if holdings is None:
        states, lots = selectors.snapshot_and_lots(own, above)
    else:
        states, lots = selectors.states_and_lots(own, above, holdings)
    states = with_place(operation, states)
    findings = settlement.check(operation, states, facts_for(operation, lab, states, lots))
    if findings:
        raise PreconditionError(findings[0].message, code=findings[0].code, findings=findings)
    return states
