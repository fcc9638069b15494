"""Write down what a halt of a device has made unknown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from labweb.common.clock import now
from labweb.crutd.models import Transaction
from labweb.crutd.services.ledger_posting import open_transaction
from labweb.crutd.services.transactions import Settlement, settle
from labweb.domain.crutd import operations
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.resources.selectors import Resource


def note_halt(row: Resource, gone: Mapping[str, Any], *, rev: int, code: str, message: str) -> None:
    """Record that fields of a resource are unknown, whoever uses it just now.

    Args:
        row: The resource, locked.
        gone: The fields, each with None.
        rev: Its counter from now on.
        code: Why, for the event.
        message: The same in words.

    Effect:
        On the record only. No lock is asked for: the device was halted, whatever acted.
    """
    operation = operations.Update(resource_id=row.id, data=dict(gone))
    made = Transaction(
        lab=row.lab,
        state=TransactionState.LOCKED.value,
        name=operations.name_of(operation).value,
        operation=operations.to_json(operation),
        proposed_at=now(),
    )
    open_transaction(made, (), ())
    outcome = Outcome(kind=OutcomeKind.DONE)
    settlement = Settlement(
        outcome=outcome, verification="device", code=code, message=message, revs={row.id: rev}
    )
    settle(made.id, settlement)
