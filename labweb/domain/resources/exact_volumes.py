"""Volumes between files and the ledger: exact, or refused."""

from __future__ import annotations

from decimal import Decimal

MAX_NL = 999_999_999_999_999
"""Largest amount: within it every nanolitre survives a double of microlitres."""


def to_nl(value: float, nl_per_unit: int) -> int | None:
    """Return whole nanolitres, or None when the number is off the grid or out of range.

    The decimal digits that the file wrote count, not their binary neighbour.

    Example:
        >>> to_nl(0.1, 1000), to_nl(0.0001, 1000)
        (100, None)
    """
    amount = Decimal(repr(value)) * nl_per_unit
    if amount != amount.to_integral_value() or not 0 <= amount <= MAX_NL:
        return None
    return int(amount)


def from_nl(amount_nl: int, nl_per_unit: int) -> float:
    """Return the number that `to_nl` reads back as the same amount.

    Example:
        >>> from_nl(500_000, 1000), from_nl(1, 1000)
        (500, 0.001)
    """
    whole, rest = divmod(amount_nl, nl_per_unit)
    return amount_nl / nl_per_unit if rest else whole
