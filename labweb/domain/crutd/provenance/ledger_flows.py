"""Posted double entries as flows of matter between accounts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

REACTION = "REACTION"
"""Account through which matter turns into other matter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerFlow:
    """One transfer as the ledger has it: all lots of one transaction between two accounts."""

    order: int
    """Place in the ledger; later is larger."""

    activity: str
    """Transaction that moved it."""

    source: str
    target: str
    at: str
    lots: Mapping[str, int]
    """Amount of each lot, in the lot's unit."""

    in_ug: frozenset[str] = frozenset()
    """Lots that are counted by mass; the others are counted in nanolitres."""

    @property
    def amount_nl(self) -> int:
        """Return the volume of all lots that are counted by volume."""
        return sum(amount for lot, amount in self.lots.items() if lot not in self.in_ug)

    @property
    def amount_ug(self) -> int:
        """Return the mass of all lots that are counted by mass."""
        return sum(amount for lot, amount in self.lots.items() if lot in self.in_ug)

    @property
    def key(self) -> tuple[str, str, str]:
        """Return what no other flow shares."""
        return (self.activity, self.source, self.target)


def is_nominal(account: str) -> bool:
    """Tell whether an account is no vessel: RECEIPT, WASTE, LOSS, REACTION."""
    return "-" not in account


def is_reaction(account: str) -> bool:
    """Tell whether matter in the account is turning into other matter."""
    return account.startswith(REACTION)
