"""Pack a run as an RO-Crate: all that somebody elsewhere needs to understand and check it.

Source:
    RO-Crate 1.1, and Workflow Run Crate 0.5 of the Workflow Run RO-Crate working group.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any
from uuid import UUID

# Tells no types.
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
from labweb.domain.crutd.provenance.prov_json_write import render_prov
from labweb.domain.crutd.provenance.recorded_facts import FileFact
from labweb.domain.errors import StateError
from labweb.domain.runs.states.job_states import RunState
from labweb.records.selectors import provenance, visible_provenance
from labweb.records.selectors import ro_crate as contents
from labweb.records.services.ro_crate_parts import (
    FILE_READINGS,
    PARTS,
    PROVENANCE,
    WORKFLOW,
    Part,
    write_json,
)
from labweb.runs.selectors import Run
from labweb.telemetry.selectors import File as Kept
from labweb.telemetry.selectors import path_of
from labweb.telemetry.services.kept_files import opened

MOST_SAMPLES = 20_000_000
"""More are refused: ask for the telemetry of single devices instead."""

_DEPTH = 50
_BLOCK = 2**20

_PROFILES = {
    "https://w3id.org/ro/wfrun/process/0.5": ("Process Run Crate", "0.5"),
    "https://w3id.org/ro/wfrun/workflow/0.5": ("Workflow Run Crate", "0.5"),
    "https://w3id.org/workflowhub/workflow-ro-crate/1.0": ("Workflow RO-Crate", "1.0"),
}
_STATUS = {
    RunState.COMPLETE.value: "http://schema.org/CompletedActionStatus",
    RunState.ABORTED.value: "http://schema.org/FailedActionStatus",
}
NO_LICENSE = "No license has been stated for these data; ask the laboratory."


def check_size(run: Run) -> None:
    """See to it that a crate can hold the samples of a run.

    Raises:
        StateError: `crate.too_large`.
    """
    count = contents.sample_count(run)
    if count > MOST_SAMPLES:
        raise StateError(
            f"run #{run.number} has {count} samples, a crate holds {MOST_SAMPLES}",
            code="crate.too_large",
            context={"samples_count": count, "most_count": MOST_SAMPLES},
        )


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
    check_size(run)
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


@dataclass(frozen=True, slots=True)
class WrittenCrate:
    """One file of a crate, as it lies on disk."""

    fact: FileFact
    about: str
    source: Path


def write_parts(run: Run, seen: Collection[UUID] | None, folder: Path) -> list[WrittenCrate]:
    """Write all that a crate of a run holds; files that were kept stay where they lie."""
    files = []
    for part in PARTS:
        part.write(run, folder / part.path)
        files.append(_measured(run, part, folder))
    files += _kept(run, seen, folder)
    facts = [file.fact for file in files]
    found = provenance.of_run(run, direction="up", depth=_DEPTH, files=facts)
    graph = found.graph if seen is None else visible_provenance.seen_by(found, seen)
    write_json(folder / PROVENANCE.path, render_prov(graph, str(run.lab_id)))
    return [*files, _measured(run, PROVENANCE, folder)]


def _kept(run: Run, seen: Collection[UUID] | None, folder: Path) -> Iterator[WrittenCrate]:
    """Yield the instrument files of a run's jobs with what was read from them, if there are any."""
    rows = list(contents.kept_files(run, seen))
    if not rows:
        return
    with (folder / FILE_READINGS.path).open("w", encoding="utf-8") as file:
        for reading in contents.file_readings(rows):
            file.write(json.dumps(reading, ensure_ascii=False, sort_keys=True) + "\n")
    yield _measured(run, FILE_READINGS, folder)
    for row in rows:
        # Checked against its digest, and closed again: what is packed is what was kept.
        opened(row).close()
        fact = FileFact(
            id=str(row.pk),
            name=contents.kept_name(row),
            run_id=str(run.pk),
            media_type=row.media_type,
            size_bytes=row.size_bytes,
            sha256=row.sha256,
        )
        about = "A series made from it" if row.made_from_id else "An instrument file as it came"
        yield WrittenCrate(fact, f"{about}: {row.name}", path_of(row.sha256))


def _packed(run: Run, seen: Collection[UUID] | None, folder: Path) -> Iterator[bytes]:
    files = write_parts(run, seen, folder)
    yield from _described(run, seen, files).stream_zip(chunk_size=_BLOCK)


def _measured(run: Run, part: Part, folder: Path) -> WrittenCrate:
    path = folder / part.path
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    fact = FileFact(
        name=part.path,
        run_id=str(run.pk),
        media_type=part.media_type,
        size_bytes=path.stat().st_size,
        sha256=digest,
    )
    return WrittenCrate(fact, part.about, path)


def _described(run: Run, seen: Collection[UUID] | None, files: Iterable[WrittenCrate]) -> ROCrate:
    """Return the crate with what each file is, who did the run, and on which devices."""
    crate = ROCrate(version="1.1")
    version = run.version
    crate.name = f"Run #{run.number}: {version.workflow.name}"
    crate.description = (
        f"Run #{run.number} of {version.workflow.name} v{version.number} in {run.lab.name}, "
        f"{'simulated' if run.lab.mode == 'sim' else 'with real instruments'}; it is {run.state}."
    )
    crate.license = NO_LICENSE
    crate.datePublished = iso(run.ended_at or now())
    # RO-Crate 1.1 has no word for it; written out, so that no reader has to fetch one more context.
    crate.metadata.extra_terms["sha256"] = "https://w3id.org/ro/terms/workflow-run#sha256"
    written = {file.fact.name: file for file in files}
    workflow = _workflow(crate, run, written.pop(WORKFLOW.path))
    entities = {name: add_file(crate, file) for name, file in written.items()}
    for row in contents.kept_files(run, seen):
        _tell_origin(crate, row, entities)
    crate.mainEntity = workflow
    _profiles(crate)
    crate.root_dataset["mentions"] = [
        _action(crate, run, workflow, entities),
        *_devices(crate, run),
    ]
    return crate


def _tell_origin(crate: ROCrate, row: Kept, entities: Mapping[str, File]) -> None:
    """Say of a kept file which resource it is about, or from which file it was made."""
    entity = entities[contents.kept_name(row)]
    if row.made_from is not None:
        entity["isBasedOn"] = entities[contents.kept_name(row.made_from)]
    elif row.resource is not None:
        resource = row.resource
        entity["about"] = crate.add(
            ContextEntity(
                crate,
                f"#resource-{resource.pk}",
                properties={
                    "@type": "IndividualProduct",
                    "name": resource.name,
                    "identifier": resource.key,
                },
            )
        )
    if row.device_id is not None:
        entity["mentions"] = {"@id": f"#device-{row.device_id}"}


def _properties(file: WrittenCrate) -> dict[str, Any]:
    fact = file.fact
    return {
        "name": fact.name,
        "description": file.about,
        "encodingFormat": fact.media_type,
        "contentSize": str(fact.size_bytes),
        "sha256": fact.sha256,
    }


def add_file(crate: ROCrate, file: WrittenCrate, prefix: str = "") -> File:
    """Add a file to a crate, with its size and checksum."""
    path = f"{prefix}{file.fact.name}"
    return crate.add_file(file.source, path, properties=_properties(file))


def _workflow(crate: ROCrate, run: Run, file: WrittenCrate) -> ComputationalWorkflow:
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
        source=file.source,
        dest_path=file.fact.name,
        properties={
            **_properties(file),
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
