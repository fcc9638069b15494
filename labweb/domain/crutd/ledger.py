"""The double-entry ledger: accounts, postings and balances.

An amount of a lot leaves one account and enters another. An account is a vessel, named by
its resource id, or one of the nominal accounts below; over all of them each lot sums to
zero. Liquids are counted in nanolitres, solids and gases in micrograms: whole numbers,
never both for one lot.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any
from uuid import UUID

from labweb.domain.resources.contents_by_lot import LotId, Phase


class Account(StrEnum):
    """Where matter is when it is in no vessel of the lab."""

    RECEIPT = "RECEIPT"
    """What was delivered came out of here: minus all that ever entered the lab."""

    WASTE = "WASTE"
    """Poured away by a person."""

    LOSS = "LOSS"
    """Evaporated or spilled."""

    DEAD_VOLUME = "DEAD_VOLUME"
    """Left behind in tubes and valves."""

    REACTION = "REACTION"
    """Consumed by a reaction; a product comes out of here."""

    SUSPENSE = "SUSPENSE"
    """A measured difference that nobody could explain."""


CORRECTION_ACCOUNTS = frozenset(
    {Account.LOSS, Account.DEAD_VOLUME, Account.REACTION, Account.SUSPENSE}
)
"""Where the difference between record and measurement may go."""


@dataclass(frozen=True, slots=True, order=True)
class Posting:
    """One double entry: an amount of `lot` leaves one account and enters the other."""

    lot: LotId
    debit: str
    """Account the lot leaves: a resource id, or a nominal account."""

    credit: str
    """Account the lot enters."""

    amount_nl: int = 0
    amount_ug: int = 0
    """Exactly one of the two is above zero: the one that the lot is counted in."""

    def to_json(self) -> dict[str, Any]:
        """Render as plain data; micrograms only where something is counted in them."""
        plain: dict[str, Any] = {"lot": self.lot, "debit": self.debit, "credit": self.credit}
        plain["amount_nl"] = self.amount_nl
        return plain | ({"amount_ug": self.amount_ug} if self.amount_ug else {})


def posting_from(plain: Mapping[str, Any]) -> Posting:
    """Read what `Posting.to_json` wrote."""
    return Posting(
        lot=LotId(plain["lot"]),
        debit=plain["debit"],
        credit=plain["credit"],
        amount_nl=plain["amount_nl"],
        amount_ug=plain.get("amount_ug", 0),
    )


def posted(lot: LotId, phase: Phase, *, debit: str, credit: str, amount: int) -> Posting:
    """Make a posting in the unit of the lot's phase."""
    if phase is Phase.LIQUID:
        return Posting(lot, debit, credit, amount_nl=amount)
    return Posting(lot, debit, credit, amount_ug=amount)


def vessel_of(account: str) -> UUID | None:
    """Return the vessel an account stands for; None for a nominal account.

    Raises:
        ValueError: It is neither.
    """
    return None if account in Account.__members__ else UUID(account)


def vessels_of(postings: Iterable[Posting]) -> set[UUID]:
    """Return every vessel that a posting takes from or adds to."""
    accounts = {account for posting in postings for account in (posting.debit, posting.credit)}
    return {vessel for account in accounts if (vessel := vessel_of(account)) is not None}


@dataclass(frozen=True, slots=True)
class Amount:
    """A balance of one lot in one account; nominal accounts may be below zero."""

    nl: int = 0
    ug: int = 0

    def __add__(self, other: Amount) -> Amount:
        return Amount(self.nl + other.nl, self.ug + other.ug)

    def __neg__(self) -> Amount:
        return Amount(-self.nl, -self.ug)

    def __bool__(self) -> bool:
        return bool(self.nl or self.ug)


Balances = Mapping[tuple[str, LotId], Amount]
"""What each account holds of each lot; balances of zero are left out."""


def book(balances: dict[tuple[str, LotId], Amount], postings: Iterable[Posting]) -> None:
    """Add postings to balances, in place; a balance that comes to zero is dropped."""
    for posting in postings:
        amount = Amount(posting.amount_nl, posting.amount_ug)
        for account, change in ((posting.debit, -amount), (posting.credit, amount)):
            key = (account, posting.lot)
            total = balances.get(key, Amount()) + change
            if total:
                balances[key] = total
            else:
                balances.pop(key, None)


def unbalanced(balances: Balances) -> Iterator[tuple[LotId, Amount]]:
    """Yield every lot that does not sum to zero over all accounts, and what is over."""
    sums: dict[LotId, Amount] = {}
    for (_, lot), amount in balances.items():
        sums[lot] = sums.get(lot, Amount()) + amount
    yield from ((lot, amount) for lot, amount in sorted(sums.items()) if amount)
