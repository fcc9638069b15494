"""Admin pages of the record, to read; and of what hosts see, which may come into the tree."""

from __future__ import annotations

from labweb.crutd.admin.candidates import Candidates
from labweb.crutd.admin.record import (
    Balances,
    Entries,
    Events,
    Holdings,
    ResourceLocks,
    Tickets,
    Transactions,
)

__all__ = [
    "Balances",
    "Candidates",
    "Entries",
    "Events",
    "Holdings",
    "ResourceLocks",
    "Tickets",
    "Transactions",
]
