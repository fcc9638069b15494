"""The files of a crate: what each is called, what it is, and how it is written."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

# Tells no types.
import pyarrow as pa  # type: ignore[import-untyped]
from pyarrow import parquet

from labweb.records.selectors import ro_crate as contents
from labweb.runs.selectors import Run

_ROWS = 50_000
_JSON, _LINES = "application/json", "application/jsonl"
_PARQUET = "application/vnd.apache.parquet"

_SCHEMA = pa.schema(
    [
        ("device", pa.dictionary(pa.int32(), pa.string())),
        ("status", pa.dictionary(pa.int32(), pa.string())),
        ("at", pa.timestamp("us", tz="UTC")),
        ("number", pa.float64()),
        ("other_json", pa.string()),
    ]
)


@dataclass(frozen=True, slots=True)
class Part:
    """One file of a crate."""

    path: str
    media_type: str
    about: str
    write: Callable[[Run, Path], None]


def write_json(path: Path, value: Any) -> None:  # noqa: ANN401 - any JSON
    """Write plain data so that the same data always gives the same bytes."""
    text = json.dumps(value, ensure_ascii=False, indent=2, sort_keys=True)
    path.write_text(text + "\n", "utf-8")


def _lines(rows: Callable[[Run], Iterable[dict[str, Any]]]) -> Callable[[Run, Path], None]:
    def write(run: Run, path: Path) -> None:
        with path.open("w", encoding="utf-8") as file:
            for row in rows(run):
                file.write(json.dumps(row, ensure_ascii=False, sort_keys=True) + "\n")

    return write


def _write_telemetry(run: Run, path: Path) -> None:
    """Write samples as Parquet, a block at a time; an empty table when there are none."""
    rows = contents.samples(run)
    with parquet.ParquetWriter(path, _SCHEMA, compression="zstd") as writer:
        while block := list(islice(rows, _ROWS)):
            columns = [list(column) for column in zip(*block, strict=True)]
            columns[2] = [round(at * 1e6) for at in columns[2]]
            arrays = [pa.array(c, f.type) for c, f in zip(columns, _SCHEMA, strict=True)]
            writer.write_table(pa.Table.from_arrays(arrays, schema=_SCHEMA))


WORKFLOW = Part(
    "workflow.json",
    _JSON,
    "The workflow version as it was drawn",
    lambda run, path: write_json(path, run.version.document),
)
PARTS = (
    WORKFLOW,
    Part(
        "plan.json",
        _JSON,
        "What the workflow meant in this lab: ordered actions with devices and amounts",
        lambda run, path: write_json(path, {"digest": run.plan_digest, "plan": run.plan}),
    ),
    Part(
        "events.jsonl",
        _LINES,
        "Events of the run's transactions in the order of the lab's hash chain",
        _lines(contents.events),
    ),
    Part(
        "host_events.jsonl",
        _LINES,
        "What edge hosts reported of each action, as it came",
        _lines(contents.host_events),
    ),
    Part("ledger.jsonl", _LINES, "What was moved, by lot", _lines(contents.ledger)),
    Part(
        "readings.jsonl", _LINES, "What devices reported with each job", _lines(contents.readings)
    ),
    Part(
        "approvals.json",
        _JSON,
        "Decisions about the run and who signed them",
        lambda run, path: write_json(path, contents.approvals(run)),
    ),
    Part(
        "telemetry.parquet",
        _PARQUET,
        "Samples of the statuses of the run's devices while it went on",
        _write_telemetry,
    ),
)
PROVENANCE = Part(
    "provenance.json",
    _JSON,
    "PROV-JSON of the run and of what went into it",
    lambda _run, _path: None,
)
FILE_READINGS = Part(
    "file_readings.jsonl",
    _LINES,
    "What was read from the instrument files of the run, with units and checksums",
    lambda _run, _path: None,
)
