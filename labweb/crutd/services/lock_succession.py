"""One transaction after another on the same things, with nobody in between."""

from __future__ import annotations

from labweb.common.clock import now
from labweb.crutd.selectors import Transaction
from labweb.crutd.services.ledger_posting import open_transaction
from labweb.crutd.services.locks import roomy_of
from labweb.domain.crutd import operations
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.runs.exclusive_use.action_locks import lock_set
from labweb.resources import selectors as resource_selectors


def lock_next(before: Transaction, operation: operations.Operation) -> Transaction:
    """Lock for an operation what a transaction has let go in this very block.

    Until the block ends, others see the locks of the first, so nobody can be in the way;
    the operation may use nothing that the first did not.

    Effect:
        None on matter. Locks hold until the new transaction is settled.
    """
    ids = operations.touched_ids(operation)
    row = Transaction(
        lab=before.lab,
        state=TransactionState.LOCKED.value,
        name=operations.name_of(operation).value,
        operation=operations.to_json(operation),
        actor_id=before.actor_id,
        job_id=before.job_id,
        proposed_at=now(),
    )
    rows = {row.id: row for row in resource_selectors.rows(ids)}
    wanted = lock_set(ids, resource_selectors.ancestors(ids), roomy_of(operation, rows))
    open_transaction(row, wanted, ())
    return row
