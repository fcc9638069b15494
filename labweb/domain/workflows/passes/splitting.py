"""An amount split into strokes."""

from __future__ import annotations


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
