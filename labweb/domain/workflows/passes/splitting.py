"""An amount split into strokes."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import structs

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.resources.contents import LotId, remove, take


def count_strokes(amount_nl: int, syringe_nl: int) -> int:
    """Count the fewest strokes that move an amount, without making any.

    Example:
        >>> count_strokes(10, 4)
        3
    """
    return -(-amount_nl // syringe_nl)


def split_strokes(amount_nl: int, syringe_nl: int) -> tuple[int, ...]:
    """Split an amount into the fewest strokes, as equal as whole nanolitres allow.

    Example:
        >>> split_strokes(10, 4)
        (4, 3, 3)
    """
    count = count_strokes(amount_nl, syringe_nl)
    base, rest = divmod(amount_nl, count)
    return tuple(base + (place < rest) for place in range(count))


def split_move(whole: TransferLiquid, stroke_nl: int) -> Iterator[TransferLiquid]:
    """Split a move into strokes, each with its share of the lots and solids that are stated."""
    rest_nl = whole.amount_nl
    lots = {LotId(lot): part for lot, part in whole.parts_nl.items()}
    solids = dict(whole.carries_ug)
    for amount_nl in split_strokes(whole.amount_nl, stroke_nl):
        parts = take(lots, amount_nl) if lots else {}
        lots = remove(lots, parts)
        # The last stroke takes along what is left.
        carries = {lot: ug * amount_nl // rest_nl for lot, ug in solids.items()}
        solids = {lot: ug - carries[lot] for lot, ug in solids.items()}
        rest_nl -= amount_nl
        yield structs.replace(
            whole,
            amount_nl=amount_nl,
            parts_nl={str(lot): part for lot, part in parts.items()},
            carries_ug=carries,
        )
