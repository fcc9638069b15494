"""Pack a run for an electronic lab notebook.

Source:
    The ELN file format of the ELN Consortium (application/vnd.eln+zip): an RO-Crate 1.1 in the
    one folder of a ZIP file, with a folder for each experiment.
"""

from __future__ import annotations

import html
import tempfile
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import IO, Any
from uuid import UUID

# Tells no types.
from rocrate.model import ContextEntity, Dataset, Person  # type: ignore[import-untyped]
from rocrate.rocrate import ROCrate  # type: ignore[import-untyped]

from labweb.common.clock import now
from labweb.common.render import iso
from labweb.records.selectors import ro_crate as contents
from labweb.records.services.ro_crate import (
    NO_LICENSE,
    WrittenCrate,
    add_file,
    check_size,
    write_parts,
)
from labweb.runs.selectors import Run

MEDIA_TYPE = "application/vnd.eln+zip"


def pack_eln(run: Run, seen: Collection[UUID] | None) -> IO[bytes]:
    """Return a run as an open .eln file that vanishes when it is closed.

    Args:
        run: What to pack.
        seen: Resources that the reader may know of; None is all.

    Raises:
        StateError: It has more samples than a crate may hold, or a kept file is damaged.
            Nothing was written.

    Effect:
        None. Writes temporary files alone.
    """
    check_size(run)
    # Returned open: whoever sends it closes it.
    packed = tempfile.TemporaryFile(prefix="labweb-eln-")  # noqa: SIM115
    try:
        with tempfile.TemporaryDirectory(prefix="labweb-eln-") as folder:
            parts, crate = Path(folder) / "parts", Path(folder) / "crate"
            parts.mkdir()
            _described(run, write_parts(run, seen, parts)).write(crate)
            _zip(crate, name_of(run), packed)
    except BaseException:
        packed.close()
        raise
    packed.seek(0)
    return packed


def name_of(run: Run) -> str:
    """Return the name of the archive, and of the one folder in it."""
    return f"run-{run.number}"


def _zip(folder: Path, name: str, target: IO[bytes]) -> None:
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                archive.write(path, f"{name}/{path.relative_to(folder).as_posix()}")


def _described(run: Run, files: Collection[WrittenCrate]) -> ROCrate:
    crate = ROCrate(version="1.1")
    title = f"Run #{run.number}: {run.version.workflow.name}"
    crate.name = title
    crate.description = f"{title} in {run.lab.name}"
    crate.license = NO_LICENSE
    crate.datePublished = iso(run.ended_at or now())
    crate.metadata.extra_terms["sha256"] = "https://w3id.org/ro/terms/workflow-run#sha256"
    publisher = {"@type": "Organization", "name": "labweb", "slogan": "Autonomous laboratories"}
    crate.metadata["sdPublisher"] = crate.add(ContextEntity(crate, "#labweb", properties=publisher))
    crate.metadata["dateCreated"] = iso(now())
    author = crate.add(
        Person(
            crate, f"#user-{run.created_by_id}", properties={"name": run.created_by.printed_name}
        )
    )
    folder = f"{name_of(run)}/"
    experiment = crate.add(Dataset(crate, dest_path=folder, properties=_experiment(run, title)))
    experiment["author"] = author
    experiment["hasPart"] = [add_file(crate, file, folder) for file in files]
    return crate


def _experiment(run: Run, title: str) -> dict[str, Any]:
    since, until = contents.window_of(run)
    return {
        "name": title,
        "identifier": str(run.pk),
        "genre": "experiment",
        "creativeWorkStatus": run.state,
        "encodingFormat": "text/html",
        "dateCreated": iso(since),
        "dateModified": iso(until),
        "text": _page(run, title),
    }


def _page(run: Run, title: str) -> str:
    """Write what was done as a page: notebooks show it as the text of the experiment."""
    rows = "".join(
        f"<li>{html.escape(job.sentence)}: {html.escape(job.state.replace('_', ' '))}"
        f"{html.escape(' (' + job.message + ')') if job.message else ''}</li>"
        for job in run.jobs.order_by("index")
    )
    kind = "simulated" if run.lab.mode == "sim" else "with real instruments"
    return (
        f"<h1>{html.escape(title)}</h1><p>{html.escape(run.lab.name)}, {kind}; "
        f"plan {html.escape(run.plan_digest)}.</p><ol>{rows}</ol>"
    )
