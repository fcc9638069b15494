"""What a vessel holds: integer amounts by lot, conserved to the last nanolitre or microgram."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Literal, NewType

from labweb.domain.errors import InfeasibleError
from labweb.domain.units import render_mass, render_volume

LotId = NewType("LotId", str)
"""Id of a lot, as text."""

Contents = Mapping[LotId, int]
"""Amounts by lot in the lot's unit, most often nanolitres; every amount is positive."""


class Phase(StrEnum):
    """What a lot is, and so what it is counted in.

    A gas is counted by mass like a solid: its volume depends on temperature and pressure,
    which nobody has stated, and its mass does not.
    """

    LIQUID = "liquid"
    """Counted in nanolitres."""

    SOLID = "solid"
    """Counted in micrograms."""

    GAS = "gas"
    """Counted in micrograms."""

    @property
    def unit(self) -> Literal["nl", "ug"]:
        """Return `nl` or `ug`."""
        return "nl" if self is Phase.LIQUID else "ug"

    def render(self, amount: int) -> str:
        """Write an amount for a person: a volume in millilitres, a mass in milligrams."""
        return render_volume(amount) if self is Phase.LIQUID else render_mass(amount)


def total_nl(contents: Contents) -> int:
    """Return the nominal volume in nanolitres."""
    return sum(contents.values())


def take(contents: Contents, amount_nl: int) -> dict[LotId, int]:
    """Split off the parts by lot that a well-mixed draw of `amount_nl` carries.

    Shares are proportional; the rounding rest goes to the largest remainders, ties to
    the lot whose id sorts first, so that the parts always sum to `amount_nl`.

    Raises:
        InfeasibleError: The vessel holds less than that.

    Example:
        >>> take({LotId("a"): 2, LotId("b"): 1}, 2)
        {'a': 1, 'b': 1}
    """
    total = total_nl(contents)
    if amount_nl < 0 or amount_nl > total:
        raise InfeasibleError(
            f"{amount_nl} nL asked of a vessel that holds {total} nL",
            code="contents.insufficient",
        )
    if amount_nl == 0:
        return {}
    shares = {lot: divmod(part * amount_nl, total) for lot, part in sorted(contents.items())}
    missing = amount_nl - sum(whole for whole, _ in shares.values())
    by_remainder = sorted(shares, key=lambda lot: (-shares[lot][1], lot))
    extra = set(by_remainder[:missing])
    parts = {lot: whole + (lot in extra) for lot, (whole, _) in shares.items()}
    return {lot: part for lot, part in parts.items() if part}


def add(contents: Contents, parts: Contents) -> dict[LotId, int]:
    """Return the contents after the parts were poured in."""
    merged = dict(contents)
    for lot, part in parts.items():
        merged[lot] = merged.get(lot, 0) + part
    return merged


def remove(contents: Contents, parts: Contents) -> dict[LotId, int]:
    """Return the contents after the parts were drawn.

    Raises:
        InfeasibleError: A lot is not there in that amount.
    """
    left = dict(contents)
    for lot, part in parts.items():
        rest = left.get(lot, 0) - part
        if rest < 0:
            raise InfeasibleError(f"lot {lot} is short by {-rest} nL", code="contents.short")
        if rest:
            left[lot] = rest
        else:
            left.pop(lot, None)
    return left
