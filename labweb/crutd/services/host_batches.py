"""Transactions that a host works off by itself: locked together, settled one by one."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from uuid import UUID

from django.db.transaction import atomic

from labweb.common.clock import now
from labweb.crutd.models import Transaction
from labweb.crutd.selectors import Transaction as TransactionRow
from labweb.crutd.selectors.run_holds import asking_holds, holds_at
from labweb.crutd.services.ledger_posting import open_transaction
from labweb.crutd.services.locks import check_free, hold_and_ask, roomy_of
from labweb.crutd.services.run_holds import Asker, check_unheld
from labweb.crutd.services.transaction_opening import check_states
from labweb.domain.crutd import operations
from labweb.domain.crutd.reserved_amounts import reservations
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.runs.exclusive_use.action_locks import lock_set
from labweb.domain.runs.host_actions.host_batch import shares
from labweb.resources.selectors import Lab


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One operation of a batch."""

    operation: operations.Operation
    targets: Collection[UUID]
    job_id: UUID
    is_first: bool
    """Nothing of the batch comes before it, so that it is checked against the present record."""


@atomic
def lock_batch(
    members: Sequence[Member],
    *,
    batch_id: UUID,
    lab: Lab,
    asker: Asker,
    granted: Collection[UUID] = (),
) -> list[TransactionRow]:
    """Take the locks of all members at once, or none.

    Members that come first are LOCKED with their amounts reserved; the others are VALIDATED
    by their plan and wait for their turn, while the batch holds what they need.

    Args:
        members: What the host does, in its order.
        batch_id: Of all of them.
        lab: Where.
        asker: Who does it, and for which run.
        granted: What the run is about to take for itself: locked against those who look.

    Raises:
        LockedError: Somebody else uses a resource, or another run holds it. Nothing was written.
        PreconditionError: A first member breaks a precondition now; findings list each.

    Effect:
        None on matter.
    """
    needed = [{*operations.touched_ids(m.operation), *m.targets} for m in members]
    ids: set[UUID] = set().union(*needed)
    found, above, (holds,) = hold_and_ask(ids.union(granted), asking_holds(ids))
    rows = {node: row for node, row in found.items() if node in ids}
    roomy = [roomy_of(m.operation, rows).difference(m.targets) for m in members]
    alone = set().union(*(set(own) - room for own, room in zip(needed, roomy, strict=True)))
    wanted = lock_set(rows, above[0], ids - alone)
    check_free(rows, wanted, asker.actor_id)
    held = holds_at(holds)
    for member, used in zip(members, needed, strict=True):
        own = {node: row for node, row in rows.items() if node in used}
        check_unheld(member.operation, own, above[0], held, asker)
        if member.is_first:
            check_states(member.operation, lab, own, above)
    claims = [lock_set(own, above[0], room) for own, room in zip(needed, roomy, strict=True)]
    made = []
    for member, claim, share in zip(members, claims, shares(claims, wanted), strict=True):
        state = TransactionState.LOCKED if member.is_first else TransactionState.VALIDATED
        row = Transaction(
            lab=lab,
            state=state.value,
            name=operations.name_of(member.operation).value,
            operation=operations.to_json(member.operation),
            actor_id=asker.actor_id,
            job_id=member.job_id,
            batch_id=batch_id,
            claims=[str(lock.resource_id) for lock in claim],
            proposed_at=now(),
        )
        promised = reservations(member.operation) if member.is_first else ()
        open_transaction(row, share, promised)
        made.append(row)
    return made
