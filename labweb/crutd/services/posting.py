"""Entries of the ledger: reserve, post and release. The database keeps the balances."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from labweb.common.clock import now
from labweb.crutd.models import Entry, Transaction
from labweb.domain.crutd.ledger import Posting
from labweb.domain.crutd.operations import Reservation


def reserve(row: Transaction, wanted: Sequence[Reservation]) -> None:
    """Promise amounts on both sides, before anything moves."""
    Entry.objects.bulk_create(
        Entry(
            transaction=row,
            debit=one.debit,
            credit=one.credit,
            amount_nl=one.amount_nl,
            amount_ug=one.amount_ug,
            state=Entry.State.PENDING,
            at=row.proposed_at,
        )
        for one in wanted
    )


def post(row: Transaction, postings: Sequence[Posting], released: Sequence[Reservation]) -> None:
    """Release what was reserved and write what moved, in one statement."""
    at = now()
    voids = [
        Entry(
            transaction=row,
            debit=one.debit,
            credit=one.credit,
            amount_nl=one.amount_nl,
            amount_ug=one.amount_ug,
            state=Entry.State.VOID,
            at=at,
        )
        for one in released
    ]
    Entry.objects.bulk_create(
        [
            *voids,
            *(
                Entry(
                    transaction=row,
                    lot_id=UUID(posting.lot),
                    debit=posting.debit,
                    credit=posting.credit,
                    amount_nl=posting.amount_nl,
                    amount_ug=posting.amount_ug,
                    state=Entry.State.POSTED,
                    at=at,
                )
                for posting in postings
            ),
        ]
    )
