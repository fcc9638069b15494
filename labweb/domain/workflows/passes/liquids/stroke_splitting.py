"""An amount split into strokes."""

from __future__ import annotations

from collections.abc import Iterator

from labweb.domain.crutd.lots_of_partial_transfer import part_of, rest_of
from labweb.domain.crutd.operations import TransferLiquid


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
    rest = whole
    for amount_nl in split_strokes(whole.amount_nl, stroke_nl):
        yield part_of(rest, amount_nl)
        rest = rest_of(rest, amount_nl)
