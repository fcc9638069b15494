"""The tray beside the bench for everything whose pose nobody knows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from twin.frames import Frame, Vector

_GAP_MM = 60.0
_BESIDE_MM = 110.0
_EDGE_MM = 40.0
TRAY_HEIGHT_MM = 12.0
_LEAST_CELL_MM = 90.0


@dataclass(frozen=True)
class Tray:
    """The tray and who stands where on it."""

    frame: Frame
    size_mm: Vector
    frames: Mapping[str, Frame]


def park(
    sizes_mm: Sequence[tuple[str, Vector]], low_mm: Vector | None, high_mm: Vector | None
) -> Tray | None:
    """Lay everything out in rows, in the order given, to the right of what has a pose.

    The tray is never at the origin of a bench: it begins beyond the right edge of all that
    is placed, or around the room's origin when nothing is.

    Args:
        sizes_mm: Id and size of what has to be parked.
        low_mm: Lowest corner of everything that has a pose; None when nothing has.
        high_mm: Its highest corner.
    """
    if not sizes_mm:
        return None
    cell_x = max(_LEAST_CELL_MM, *(size[0] for _, size in sizes_mm)) + _GAP_MM
    cell_y = max(_LEAST_CELL_MM, *(size[1] for _, size in sizes_mm)) + _GAP_MM
    columns = _columns(len(sizes_mm), cell_x, cell_y, low_mm, high_mm)
    rows = math.ceil(len(sizes_mm) / columns)
    size = (columns * cell_x + 2 * _EDGE_MM, rows * cell_y + 2 * _EDGE_MM, TRAY_HEIGHT_MM)
    if low_mm is None or high_mm is None:
        origin: Vector = (-size[0] / 2.0, -size[1] / 2.0, 0.0)
    else:
        origin = (high_mm[0] + _BESIDE_MM, low_mm[1], low_mm[2])
    frames = {}
    for number, (key, extent) in enumerate(sizes_mm):
        # The first row is at the back, so that one reads it from left to right and down.
        column, row = number % columns, rows - 1 - number // columns
        frames[key] = Frame(
            (
                origin[0] + _EDGE_MM + column * cell_x + (cell_x - extent[0]) / 2.0,
                origin[1] + _EDGE_MM + row * cell_y + (cell_y - extent[1]) / 2.0,
                origin[2] + TRAY_HEIGHT_MM,
            )
        )
    return Tray(Frame(origin), size, frames)


def _columns(
    count: int, cell_x: float, cell_y: float, low: Vector | None, high: Vector | None
) -> int:
    """Choose rows no deeper than the bench, or a tray of 8 to 5 when there is no bench."""
    if low is not None and high is not None:
        rows = max(1, int((high[1] - low[1] - 2 * _EDGE_MM) // cell_y))
        if count <= 4 * rows:
            return math.ceil(count / rows)
    return max(1, min(count, round(math.sqrt(count * 1.6 * cell_y / cell_x))))
