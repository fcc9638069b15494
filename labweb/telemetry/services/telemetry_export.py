"""Telemetry as a file: CSV as the database writes it, or Parquet made from that."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any
from uuid import UUID

# Tells no types.
import pyarrow as pa  # type: ignore[import-untyped]
from django.db import connection
from pyarrow import csv, parquet

from labweb.domain.errors import DefinitionError
from labweb.domain.telemetry_resolution import RAW

MOST_ROWS = 2_000_000
"""More are refused: a shorter range, fewer statuses or a coarser level."""

_AT = pa.timestamp("us", tz="UTC")
_WHO = {"at": _AT, "device": pa.string(), "status": pa.string(), "unit": pa.string()}
_COLUMNS = {
    RAW: {**_WHO, "number": pa.float64(), "other_json": pa.string()},
    None: {
        **_WHO,
        "width_s": pa.int32(),
        "mean": pa.float64(),
        "lowest": pa.float64(),
        "highest": pa.float64(),
        "count": pa.int64(),
    },
}

_MOMENT = "to_char(to_timestamp(at) AT TIME ZONE 'UTC', 'YYYY-MM-DD\"T\"HH24:MI:SS.US\"Z\"') AS at"
_FROM_RAW = """
FROM telemetry_sample WHERE device_id = %(device_id)s AND status = ANY(%(statuses)s)
    AND at >= %(since)s AND at < %(until)s
"""
_FROM_BUCKETS = """
FROM telemetry_rollup WHERE device_id = %(device_id)s AND status = ANY(%(statuses)s)
    AND level_s = %(level)s AND at >= %(since)s AND at < %(until)s
"""
_NUMBERS = """CASE WHEN jsonb_typeof(value) = 'number' THEN value::float8 END AS number,
    CASE WHEN jsonb_typeof(value) <> 'number' THEN value::text END AS other_json"""
_BUCKETS = "level_s AS width_s, mean, low AS lowest, high AS highest, count"
_WRITE = """
COPY (
    SELECT {moment}, %(key)s::text AS device, status, %(units)s::jsonb ->> status AS unit, {values}
    {rows} ORDER BY status, telemetry_{table}.at
) TO STDOUT WITH (FORMAT csv, HEADER true)
"""
_COUNT = "SELECT count(*) FROM (SELECT 1 {rows} LIMIT %(most)s) AS asked"


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedSeries:
    """What shall be in a file."""

    device_id: UUID
    device_key: str
    units: Mapping[str, str]
    """As a person reads them, by status."""

    statuses: Sequence[str]
    since_s: float
    until_s: float
    level_s: int
    """Width of the buckets; `RAW`: samples."""


def write_csv(wanted: WantedSeries) -> IO[bytes]:
    """Write what is wanted as CSV into a file that is gone when it is closed.

    The columns are `at` (UTC, ISO 8601, µs; the begin of a bucket), `device`, `status`, `unit`, and
    of samples `number` or `other_json`, of buckets `width_s mean lowest highest count`. Rows are
    ordered by status and time. A gap has no row.

    Raises:
        DefinitionError: There are more rows than a file may have; nothing was written.
    """
    is_raw = wanted.level_s == RAW
    rows = _FROM_RAW if is_raw else _FROM_BUCKETS
    values: dict[str, Any] = {
        "device_id": wanted.device_id,
        "key": wanted.device_key,
        "units": json.dumps(dict(wanted.units)),
        "statuses": list(wanted.statuses),
        "since": wanted.since_s,
        "until": wanted.until_s,
        "level": wanted.level_s,
        "most": MOST_ROWS + 1,
    }
    query = _WRITE.format(
        moment=_MOMENT,
        values=_NUMBERS if is_raw else _BUCKETS,
        rows=rows,
        table="sample" if is_raw else "rollup",
    )
    with connection.cursor() as cursor:
        cursor.execute(_COUNT.format(rows=rows), values)
        if cursor.fetchone()[0] > MOST_ROWS:
            raise DefinitionError(
                f"more than {MOST_ROWS} rows are asked for: shorten the range, or choose a "
                "coarser level or fewer statuses",
                code="telemetry.too_large",
                context={"most_count": MOST_ROWS},
            )
        file = tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
        with cursor.copy(query, values) as copied:
            for block in copied:
                file.write(block)
    file.seek(0)
    return file


def write_parquet(wanted: WantedSeries) -> IO[bytes]:
    """Write the same as Parquet, a block at a time.

    Raises:
        DefinitionError: As for CSV.
    """
    types = _COLUMNS[RAW if wanted.level_s == RAW else None]
    target = tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
    with (
        write_csv(wanted) as source,
        csv.open_csv(
            source,
            parse_options=csv.ParseOptions(newlines_in_values=True),
            convert_options=csv.ConvertOptions(
                column_types=types, strings_can_be_null=True, quoted_strings_can_be_null=False
            ),
        ) as blocks,
        parquet.ParquetWriter(target, pa.schema(types), compression="zstd") as writer,
    ):
        for block in blocks:
            writer.write_batch(block)
    target.seek(0)
    return target
