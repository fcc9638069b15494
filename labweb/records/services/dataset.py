"""Write what runs measured as one table: a row for each value, with its full lineage."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

# Tells no types.
import pyarrow as pa  # type: ignore[import-untyped]
from pyarrow import parquet

from labweb.domain.errors import StateError
from labweb.records.selectors.dataset import DatasetValue, values_of
from labweb.runs.selectors import Run
from labweb.telemetry.selectors import File, Reading, path_of
from labweb.telemetry.services.kept_files import opened

MOST_ROWS = 20_000_000
"""More are refused: export fewer runs at a time."""

_ROWS = 20_000

_AT = pa.timestamp("us", tz="UTC")
_LOT = pa.struct(
    [
        ("vessel", pa.string()),
        ("lot", pa.string()),
        ("material", pa.string()),
        ("inchikey", pa.string()),
        ("supplier", pa.string()),
        ("number", pa.string()),
        ("amount", pa.int64()),
        ("amount_unit", pa.string()),
    ]
)
_CONDITION = pa.struct(
    [
        ("device", pa.string()),
        ("status", pa.string()),
        ("age_s", pa.float64()),
        ("number", pa.float64()),
        ("other_json", pa.string()),
    ]
)
_AXIS = pa.struct(
    [("name", pa.string()), ("unit", pa.string()), ("number", pa.float64()), ("text", pa.string())]
)

SCHEMA = pa.schema(
    [
        ("run_id", pa.string()),
        ("run_number", pa.int32()),
        ("workflow", pa.string()),
        ("workflow_digest", pa.string()),
        ("plan_digest", pa.string()),
        ("started_by", pa.string()),
        ("job_id", pa.string()),
        ("job_index", pa.int32()),
        ("sentence", pa.string()),
        ("job_state", pa.string()),
        ("started_at", _AT),
        ("ended_at", _AT),
        ("device", pa.string()),
        ("driver", pa.string()),
        ("driver_digest", pa.string()),
        ("verification", pa.string()),
        ("source", pa.string()),
        ("quantity", pa.string()),
        ("unit", pa.string()),
        ("number", pa.float64()),
        ("text", pa.string()),
        ("axes", pa.list_(_AXIS)),
        ("measured_at", _AT),
        ("reading_id", pa.string()),
        ("file_sha256", pa.string()),
        ("vessels", pa.list_(pa.string())),
        ("lots", pa.list_(_LOT)),
        ("came_through", pa.list_(pa.string())),
        ("is_lineage_whole", pa.bool_()),
        ("conditions", pa.list_(_CONDITION)),
    ]
)
"""Columns of the table; `docs/files.md` says what each holds."""


def write_values(runs: Iterable[Run], path: Path) -> int:
    """Write every measured value of some runs as Parquet.

    Returns:
        How many rows there are.

    Raises:
        StateError: There are more than a table may hold, or a kept file is damaged.
        ReconcileError: The record of the lab cannot be replayed.

    Effect:
        None. Writes the one file.
    """
    rows = (row for run in runs for value in values_of(run) for row in _rows(value))
    count = 0
    with parquet.ParquetWriter(path, SCHEMA, compression="zstd") as writer:
        while block := list(islice(rows, _ROWS)):
            count += len(block)
            if count > MOST_ROWS:
                raise StateError(
                    f"these runs measured more than {MOST_ROWS} values",
                    code="dataset.too_large",
                    context={"most_count": MOST_ROWS},
                )
            writer.write_table(pa.Table.from_pylist(block, schema=SCHEMA))
    return count


def _rows(value: DatasetValue) -> Iterator[dict[str, Any]]:
    plain = {**value.lineage, **value.measured, "axes": []}
    if value.series is None:
        yield plain
        return
    for number, axes in _points(value.series):
        yield {**plain, "number": number, "axes": axes}


def _points(reading: Reading) -> Iterator[tuple[float, list[dict[str, Any]]]]:
    """Yield each point of a series that is no gap, with its place on every axis."""
    file, series = reading.series_file, reading.series
    if file is None or series is None:
        raise ValueError("a reading without a series")
    axes = series["axes"]
    names = [axis["column"] for axis in axes]
    with parquet.ParquetFile(_checked(file)) as table:
        for batch in table.iter_batches(columns=[*names, series["column"]], batch_size=_ROWS):
            for row in batch.to_pylist():
                if row[series["column"]] is not None:
                    yield row[series["column"]], [_axis(axis, row[axis["column"]]) for axis in axes]


def _checked(file: File) -> Path:
    opened(file).close()
    return path_of(file.sha256)


def _axis(axis: dict[str, Any], value: Any) -> dict[str, Any]:  # noqa: ANN401 - a number or a time
    is_number = isinstance(value, int | float)
    return {
        "name": axis["column"],
        "unit": axis["unit"],
        "number": float(value) if is_number else None,
        "text": None if is_number else value.isoformat(),
    }
