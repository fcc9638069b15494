"""Posted double entries as flows of matter between accounts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

REACTION = "REACTION"
"""Account through which matter turns into other matter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Flow:
    """One transfer as the ledger has it: all lots of one transaction between two accounts."""

    order: int
    """Place in the ledger; later is larger."""

    activity: str
    """Transaction that moved it."""

    source: str
    target: str
    amount_nl: int
    at: str
    lots: Mapping[str, int]

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
