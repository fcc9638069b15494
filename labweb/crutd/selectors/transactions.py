"""Reads of transactions, and what jobs posted by them."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

from labweb.crutd.models import Entry, Transaction
from labweb.domain.crutd import operations
from labweb.domain.crutd.mass_balance import MassMove
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import NotFoundError
from labweb.domain.resources.contents_by_lot import LotId


def transaction_for_update(transaction_id: UUID) -> Transaction:
    """Lock and return a transaction.

    Raises:
        NotFoundError: There is none.
    """
    row = Transaction.objects.filter(pk=transaction_id).select_for_update(no_key=True).first()
    if row is None:
        raise NotFoundError(f"no transaction {transaction_id}", code="crutd.no_transaction")
    return row


def find_transaction(transaction_id: UUID) -> Transaction:
    """Return a transaction.

    Raises:
        NotFoundError: There is none.
    """
    row = Transaction.objects.filter(pk=transaction_id).first()
    if row is None:
        raise NotFoundError(f"no transaction {transaction_id}", code="crutd.no_transaction")
    return row


def posted_by(job_ids: Iterable[UUID]) -> list[MassMove]:
    """Return what the jobs moved, entry by entry."""
    rows = Entry.objects.filter(state=Entry.State.POSTED, transaction__job_id__in=list(job_ids))
    columns = ("lot_id", "debit", "credit", "amount_nl", "amount_ug")
    return [
        MassMove(LotId(str(lot)), debit, credit, nl, ug)
        for lot, debit, credit, nl, ug in rows.values_list(*columns)
    ]


def reactions_of(job_ids: Iterable[UUID]) -> list[operations.React]:
    """Return the reactions that the jobs have put on record, in their order."""
    done = Transaction.objects.filter(
        job_id__in=list(job_ids), state=TransactionState.COMMITTED.value, operation__op="react"
    )
    told = done.order_by("settled_at", "id").values_list("operation", flat=True)
    found = (operations.from_json(plain) for plain in told)
    return [one for one in found if isinstance(one, operations.React)]
