"""Read one instrument file into a folder: `python -m labweb.common.instruments FORMAT FILE FOLDER`.

It writes `found.json` and a Parquet file per table. Time and memory are bounded, and what a
library does not survive ends this process alone.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from datetime import datetime
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

# Tells no types.
import pyarrow as pa  # type: ignore[import-untyped]
from pyarrow import parquet

from labweb.common.instruments.model import MOST_READINGS, Column, Found, Parsed, stop
from labweb.common.limits.process_bounds import limit_process
from labweb.domain.errors import LabError

MAX_CPU_S = 120
MAX_MEMORY_BYTES = 4 * 2**30
MAX_FILE_BYTES = 2 * 2**30

REFUSED = 3
"""Exit code when the file was read and found wrong; `found.json` says why."""

_READERS = {
    "csv": "csv_file",
    "xml": "xml_file",
    "mzml": "mzml",
    "jcamp": "jcamp_dx",
    "andi": "andi",
    "neware": "neware",
}


def main(arguments: Sequence[str]) -> int:
    """Read the file, and write what was found or what is wrong with it."""
    kind, source, folder = arguments
    reader: Callable[[Path], Parsed] = import_module(
        f"labweb.common.instruments.{_READERS[kind]}"
    ).read
    target = Path(folder)
    try:
        found = _written(reader(Path(source)), target)
        code = 0
    except LabError as error:
        found = {"error": error.to_json()}
        code = REFUSED
    text = json.dumps(found, ensure_ascii=False, allow_nan=False)
    (target / "found.json").write_text(text, "utf-8")
    return code


def _written(parsed: Parsed, folder: Path) -> dict[str, Any]:
    if len(parsed.readings) > MOST_READINGS:
        raise stop(f"the file gives more than {MOST_READINGS} readings", "")
    tables = []
    for place, columns in enumerate(parsed.tables):
        name = f"{place}.parquet"
        parquet.write_table(_table(columns), folder / name, compression="zstd")
        tables.append({"file": name, "rows": len(columns[0].values)})
    readings = [_reading(found, parsed.tables) for found in parsed.readings]
    return {"facts": dict(parsed.facts), "tables": tables, "readings": readings}


def _table(columns: Sequence[Column]) -> pa.Table:
    arrays = [_array(column) for column in columns]
    fields = [
        pa.field(column.name, array.type, metadata={"unit": column.unit})
        for column, array in zip(columns, arrays, strict=True)
    ]
    return pa.table(arrays, schema=pa.schema(fields))


def _array(column: Column) -> pa.Array:
    told = next((value for value in column.values if value is not None), None)
    if isinstance(told, datetime):
        return pa.array(column.values, pa.timestamp("us", tz="UTC"))
    if isinstance(told, str):
        return pa.array(column.values, pa.string())
    if isinstance(column.values, np.ndarray) and column.values.dtype.kind in "iu":
        return pa.array(column.values, pa.int64())
    return pa.array(column.values, pa.float64())


def _reading(found: Found, tables: Sequence[Sequence[Column]]) -> dict[str, Any]:
    plain: dict[str, Any] = {
        "name": found.name,
        "quantity": found.quantity,
        "unit": found.unit,
        "value": found.value,
        "text": found.text,
        "measured_at": found.measured_at,
        "facts": dict(found.facts),
        "table": found.table,
        "series": None,
    }
    if found.table is not None:
        columns = {column.name: column for column in tables[found.table]}
        plain["series"] = {
            **_span(columns[found.column]),
            "axes": [_span(columns[name]) for name in found.axes],
        }
    return plain


def _span(column: Column) -> dict[str, Any]:
    """Say what a column is and how far its values go."""
    told = [value for value in column.values if value is not None]
    low, high = (min(told), max(told)) if told else (None, None)
    return {
        "column": column.name,
        "unit": column.unit,
        "points_count": len(told),
        "least": _plain(low),
        "most": _plain(high),
    }


def _plain(value: object) -> object:
    if isinstance(value, datetime):
        return value.isoformat()
    return value.item() if isinstance(value, np.generic) else value


if __name__ == "__main__":
    limit_process(cpu_s=MAX_CPU_S, memory_bytes=MAX_MEMORY_BYTES, file_bytes=MAX_FILE_BYTES)
    sys.exit(main(sys.argv[1:]))
