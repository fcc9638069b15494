"""Read points of a kept series for a plot: few enough to draw, with every peak."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

# Tells no types.
import pyarrow as pa  # type: ignore[import-untyped]
from pyarrow import compute, parquet

SCAN = "scan"
"""An axis of this name numbers spectra: points of one of them are drawn, over the next axis."""

_ROWS = 65_536


@dataclass(frozen=True, slots=True)
class Drawn:
    """Points of a series in the order of its file."""

    points: Sequence[tuple[float, float | None]]
    """(x, y); null where the file has a gap."""

    rows_count: int
    """Rows that the file has for them."""

    is_thinned: bool
    """Of each stretch of rows only the least and the largest value are given."""


def axes_of(series: Mapping[str, Any]) -> tuple[Mapping[str, Any], Mapping[str, Any] | None]:
    """Return the axis to draw over, and the one that numbers the spectra if there are several."""
    first, *others = series["axes"]
    return (others[0], first) if first["column"] == SCAN and others else (first, None)


def points(path: Path, series: Mapping[str, Any], *, scan: int | None, most: int) -> Drawn:
    """Read a measured column over its axis.

    Args:
        path: Series as Parquet.
        series: What its reading tells of columns and axes.
        scan: Which spectrum, where there are several.
        most: Points that are given at most; twice the number of stretches that a long series
            is divided into.

    Raises:
        TypeError: The axis is no number and no time.

    Effect:
        None. Holds two columns of one block of rows, and the points.
    """
    axis, numbering = axes_of(series)
    names = [axis["column"], series["column"]]
    if numbering is None or scan is None:
        rows, count = _blocks(path, names), parquet.ParquetFile(path).metadata.num_rows
    else:
        rows = _blocks(path, names, where=(numbering["column"], scan))
        count = sum(len(x) for x, _ in rows)
        rows = _blocks(path, names, where=(numbering["column"], scan))
    if count <= most:
        return Drawn([point for block in rows for point in _pairs(*block)], count, is_thinned=False)
    return Drawn(_thinned(rows, count, most // 2), count, is_thinned=True)


def _blocks(
    path: Path, names: Sequence[str], where: tuple[str, int] | None = None
) -> Iterator[tuple[Any, Any]]:
    """Yield x and y of a block of rows, gaps as NaN."""
    columns = list(names) if where is None else [*names, where[0]]
    for batch in parquet.ParquetFile(path).iter_batches(batch_size=_ROWS, columns=columns):
        kept = batch
        if where is not None:
            kept = batch.filter(compute.equal(batch.column(where[0]), where[1]))
        yield _numbers(kept.column(names[0])), _numbers(kept.column(names[1]))


def _numbers(column: Any) -> Any:  # noqa: ANN401 - arrays of two libraries without types
    """Return numbers; times as seconds since 1970."""
    if pa.types.is_timestamp(column.type):
        micros = column.cast(pa.timestamp("us", tz="UTC")).cast(pa.int64())
        return micros.to_numpy(zero_copy_only=False) / 1e6
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise TypeError(f"a column of {column.type} cannot be drawn")
    return column.cast(pa.float64()).to_numpy(zero_copy_only=False)


def _pairs(x: Any, y: Any) -> list[tuple[float, float | None]]:  # noqa: ANN401 - arrays
    found = zip(x.tolist(), y.tolist(), strict=True)
    return [(one, None if np.isnan(other) else other) for one, other in found]


def _thinned(
    blocks: Iterator[tuple[Any, Any]], count: int, stretches: int
) -> list[tuple[float, float | None]]:
    """Return the least and the largest value of each stretch of rows, in their order."""
    edges = np.linspace(0, count, stretches + 1).astype(int)
    found: list[tuple[float, float | None]] = []
    left_x, left_y, row, place = np.array([]), np.array([]), 0, 0
    for x, y in blocks:
        left_x, left_y = np.concatenate([left_x, x]), np.concatenate([left_y, y])
        while place < stretches and edges[place + 1] <= row + len(left_x):
            size = int(edges[place + 1]) - row
            found += _extremes(left_x[:size], left_y[:size])
            left_x, left_y = left_x[size:], left_y[size:]
            row, place = row + size, place + 1
    return found


def _extremes(x: Any, y: Any) -> list[tuple[float, float | None]]:  # noqa: ANN401 - arrays
    if not len(x):
        return []
    if np.isnan(y).all():
        return [(float(x[0]), None)]
    picked = sorted({int(np.nanargmin(y)), int(np.nanargmax(y))})
    return [(float(x[i]), float(y[i])) for i in picked]
