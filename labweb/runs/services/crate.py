"""Pack a run as an RO-Crate: all that somebody elsewhere needs to understand and check it.

Source:
    RO-Crate 1.1, and Workflow Run Crate 0.5 of the Workflow Run RO-Crate working group.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO, Any
from uuid import UUID

# Neither library tells its types.
import pyarrow as pa  # type: ignore[import-untyped]
from pyarrow import parquet
from rocrate.model import (  # type: ignore[import-untyped]
    ComputationalWorkflow,
    ComputerLanguage,
    ContextEntity,
    Person,
)
from rocrate.model.file import File  # type: ignore[import-untyped]
from rocrate.rocrate import ROCrate  # type: ignore[import-untyped]

from labweb.common.clock import now
from labweb.common.render import iso
from labweb.domain.crutd.provenance.facts import FileFact
from labweb.domain.crutd.provenance.prov_json import render_prov
from labweb.domain.errors import StateError
from labweb.domain.runs.job import RunState
from labweb.runs.models import Run
from labweb.runs.selectors import crate as contents
from labweb.runs.selectors import provenance

MOST_SAMPLES = 20_000_000
"""More are refused: ask for the telemetry of single devices instead."""

_DEPTH = 50
_ROWS = 50_000
_BLOCK = 2**20

_SCHEMA = pa.schema(
    [
        ("device", pa.dictionary(pa.int32(), pa.string())),
        ("status", pa.dictionary(pa.int32(), pa.string())),
        ("at", pa.timestamp("us", tz="UTC")),
        ("number", pa.float64()),
        ("other_json", pa.string()),
    ]
)

_PROFILES = {
    "https://w3id.org/ro/wfrun/process/0.5": ("Process Run Crate", "0.5"),
    "https://w3id.org/ro/wfrun/workflow/0.5": ("Workflow Run Crate", "0.5"),
    "https://w3id.org/workflowhub/workflow-ro-crate/1.0": ("Workflow RO-Crate", "1.0"),
}
_STATUS = {
    RunState.COMPLETE.value: "http://schema.org/CompletedActionStatus",
    RunState.ABORTED.value: "http://schema.org/FailedActionStatus",
}
_NO_LICENSE = "No license has been stated for these data; ask the laboratory."
_JSON, _LINES = "application/json", "application/jsonl"
_PARQUET = "application/vnd.apache.parquet"


@dataclass(frozen=True, slots=True)
class Part:
    """One file of a crate."""

    path: str
    media_type: str
    about: str
    write: Callable[[Run, Path], None]


def pack_run(run: Run, seen: Collection[UUID] | None) -> IO[bytes]:
    """Return a crate of a run as an open file that vanishes when it is closed.

    Args:
        run: What to pack.
        seen: Resources that the reader may know of, for the provenance of what went into the
            run; None is all.

    Raises:
        StateError: It has more samples than a crate may hold. Nothing was written.

    Effect:
        None. Writes temporary files alone.
    """
    count = contents.sample_count(run)
    if count > MOST_SAMPLES:
        raise StateError(
            f"run #{run.number} has {count} samples, a crate holds {MOST_SAMPLES}",
            code="crate.too_large",
            context={"samples_count": count, "most_count": MOST_SAMPLES},
        )
    # Returned open: whoever sends it closes it.
    packed = tempfile.TemporaryFile(prefix="labweb-crate-")  # noqa: SIM115
    try:
        with tempfile.TemporaryDirectory(prefix="labweb-crate-") as folder:
            for block in _packed(run, seen, Path(folder)):
                packed.write(block)
    except BaseException:
        packed.close()
        raise
    packed.seek(0)
    return packed


def _packed(run: Run, seen: Collection[UUID] | None, folder: Path) -> Iterator[bytes]:
    files: list[FileFact] = []
    for part in _PARTS:
        target = folder / part.path
        part.write(run, target)
        files.append(_measured(run, part, target))
    found = provenance.of_run(run, direction="up", depth=_DEPTH, files=files)
    graph = found.graph if seen is None else provenance.seen_by(found, seen)
    target = folder / _PROVENANCE.path
    _write_json(target, render_prov(graph, str(run.lab_id)))
    files.append(_measured(run, _PROVENANCE, target))
    yield from _described(run, folder, files).stream_zip(chunk_size=_BLOCK)


def _measured(run: Run, part: Part, path: Path) -> FileFact:
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return FileFact(
        name=part.path,
        run_id=str(run.pk),
        media_type=part.media_type,
        size_bytes=path.stat().st_size,
        sha256=digest,
    )


def _described(run: Run, folder: Path, files: Iterable[FileFact]) -> ROCrate:
    """Return the crate with what each file is, who did the run, and on which devices."""
    crate = ROCrate(version="1.1")
    version = run.version
    crate.name = f"Run #{run.number}: {version.workflow.name}"
    crate.description = (
        f"Run #{run.number} of {version.workflow.name} v{version.number} in {run.lab.name}, "
        f"{'simulated' if run.lab.mode == 'sim' else 'with real instruments'}; it is {run.state}."
    )
    crate.license = _NO_LICENSE
    crate.datePublished = iso(run.ended_at or now())
    # RO-Crate 1.1 has no word for it; written out, so that no reader has to fetch one more context.
    crate.metadata.extra_terms["sha256"] = "https://w3id.org/ro/terms/workflow-run#sha256"
    facts = {fact.name: fact for fact in files}
    workflow = _workflow(crate, run, folder, facts.pop(_WORKFLOW.path))
    entities = {name: _file(crate, folder, fact) for name, fact in facts.items()}
    crate.mainEntity = workflow
    _profiles(crate)
    crate.root_dataset["mentions"] = [
        _action(crate, run, workflow, entities),
        *_devices(crate, run),
    ]
    return crate


def _properties(fact: FileFact) -> dict[str, Any]:
    return {
        "name": fact.name,
        "description": next(part.about for part in _ALL if part.path == fact.name),
        "encodingFormat": fact.media_type,
        "contentSize": str(fact.size_bytes),
        "sha256": fact.sha256,
    }


def _file(crate: ROCrate, folder: Path, fact: FileFact) -> File:
    return crate.add_file(folder / fact.name, fact.name, properties=_properties(fact))


def _workflow(crate: ROCrate, run: Run, folder: Path, fact: FileFact) -> ComputationalWorkflow:
    language = crate.add(
        ComputerLanguage(
            crate,
            "#labweb-workflow",
            properties={
                "name": "labweb workflow",
                "version": str(run.version.document.get("schema", "")) or "unknown",
            },
        )
    )
    workflow = ComputationalWorkflow(
        crate,
        source=folder / fact.name,
        dest_path=fact.name,
        properties={
            **_properties(fact),
            "name": f"{run.version.workflow.name} v{run.version.number}",
            "version": str(run.version.number),
            "identifier": run.version.digest,
        },
    )
    crate.add(workflow)
    workflow["programmingLanguage"] = language
    return workflow


def _profiles(crate: ROCrate) -> None:
    """Say which profiles the crate follows."""
    found = [
        crate.add(
            ContextEntity(
                crate,
                address,
                properties={"@type": "CreativeWork", "name": name, "version": version},
            )
        )
        for address, (name, version) in _PROFILES.items()
    ]
    crate.root_dataset["conformsTo"] = found


def _action(
    crate: ROCrate, run: Run, workflow: ComputationalWorkflow, entities: dict[str, File]
) -> ContextEntity:
    person = crate.add(
        Person(
            crate,
            f"#user-{run.created_by_id}",
            properties={"name": run.created_by.printed_name},
        )
    )
    since, until = contents.window_of(run)
    plan = entities["plan.json"]
    results = [entity for name, entity in entities.items() if name != "plan.json"]
    action = crate.add_action(
        workflow,
        identifier=f"#run-{run.pk}",
        object=[plan],
        result=results,
        properties={
            "name": f"Run #{run.number}",
            "startTime": iso(since),
            "endTime": iso(until),
            "actionStatus": {"@id": _STATUS.get(run.state, "http://schema.org/ActiveActionStatus")},
        },
    )
    action["agent"] = person
    return action


def _devices(crate: ROCrate, run: Run) -> list[ContextEntity]:
    return [
        crate.add(
            ContextEntity(
                crate,
                f"#device-{device.pk}",
                properties={
                    "@type": "IndividualProduct",
                    "name": device.name,
                    "identifier": device.key,
                    "description": f"driver {device.driver.module}:{device.driver.class_name}, "
                    f"sha256 of its source {device.driver.digest}",
                },
            )
        )
        for device in contents.devices_of(run)
    ]


def _write_json(path: Path, value: Any) -> None:  # noqa: ANN401 - any JSON
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


_WORKFLOW = Part(
    "workflow.json",
    _JSON,
    "The workflow version as it was drawn",
    lambda run, path: _write_json(path, run.version.document),
)
_PARTS = (
    _WORKFLOW,
    Part(
        "plan.json",
        _JSON,
        "What the workflow meant in this lab: ordered actions with devices and amounts",
        lambda run, path: _write_json(path, {"digest": run.plan_digest, "plan": run.plan}),
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
        lambda run, path: _write_json(path, contents.approvals(run)),
    ),
    Part(
        "telemetry.parquet",
        _PARQUET,
        "Samples of the statuses of the run's devices while it went on",
        _write_telemetry,
    ),
)
_PROVENANCE = Part(
    "provenance.json",
    _JSON,
    "PROV-JSON of the run and of what went into it",
    lambda _run, _path: None,
)
_ALL = (*_PARTS, _PROVENANCE)
