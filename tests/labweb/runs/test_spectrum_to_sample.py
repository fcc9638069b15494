"""A spectrum from the instrument's wire to the sample's record.

```text
simulated NMR ──TCP, HTTP──▶ driver in its confined line ──journal, files──▶ host ──▶ server
```
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import pytest
from pytest_django import Settings

from drivers.transports.urls import line_key
from labweb.common.clock import new_id, now
from labweb.crutd import services as crutd_services
from labweb.domain.action_files import PART_BYTES, WANTED, FileOffer, FilePart, FileParts
from labweb.domain.crutd.operations import Create
from labweb.domain.messages.commands import Command
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.runs.dispatch import command_outbox
from labweb.enrollment import services as enrollment_services
from labweb.fleet.services import host_events
from labweb.runs import services
from labweb.runs.models import Job, Outbox, Run
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry import services as telemetry_services
from labweb.telemetry.models import File, Incoming, Reading
from labweb.workflows import services as workflow_services
from tests.builders import Bench, Edge, catalog
from tests.drivers.conformance.placed_models import a_free_port
from tests.fixtures.hand_bench import a_document, a_vessel
from tests.fixtures.running import ROOT, Process
from tests.workers.bench import Server
from tests.workers.line.test_action_files import NAMES, SHORT
from tests.workers.sandbox.test_confinement import a_config, confining
from workers.base.config import HostConfig, line_queue
from workers.base.host_key import create_key
from workers.base.wake_pipe import hang
from workers.journal.command_acceptance import accept
from workers.journal.journal import Journal, create_journal
from workers.line.action_files import WaitingFiles
from workers.uplink.session import arm, open_session

DRIVER = "drivers.characterization.magritek_spinsolve:MagritekSpinsolve"


@pytest.fixture
def lab(bench: Bench, settings: Settings, tmp_path: Path) -> Iterator[tuple[Bench, str]]:
    """Add an NMR spectrometer with a tube in its bore to the starter lab; yield its line."""
    settings.DATA_DIR = tmp_path / "server"
    with TemporaryDirectory(prefix="lw") as name:
        folder, port = Path(name), a_free_port()
        spectrometer = {
            "id": "nmr",
            "model": "magritek_spinsolve",
            "endpoint": "tcp:127.0.0.1:0",
            "settings": {"share_port": port},
            "attached": {"vessel": "tube"},
        }
        document = a_document(spectrometer, vessels=[a_vessel("tube", 600.0)])
        (folder / "bench.json").write_text(json.dumps(document))
        process = Process(folder)
        process.start("--speed", "100")
        url = f"tcp://127.0.0.1:{process.port_of('nmr')}?share={port}"
        for key, kind, parent in (("nmr", "workstation", "bench_1"), ("tube", "vial", "nmr")):
            create = Create(
                resource_id=new_id(), parent_id=bench.node(parent).id, key=key, name=key, kind=kind
            )
            crutd_services.carry_out(create, lab=bench.lab, actor_id=bench.people["admin"].pk)
        enrollment_services.found_device(
            bench.lab,
            new_id(),
            key="nmr",
            name="NMR",
            host_id=bench.host.id,
            driver=enrollment_services.keep_driver(catalog()[DRIVER]),
            transport=url,
            config={"data_root": process.get("/instruments/nmr")["state"]["data_root"]},
            nodes={"spectrometer": str(bench.node("nmr").id)},
            state="enrolled",
        )
        yield bench, url
        process.stop()


def started(lab: Bench) -> Run:
    """Start a workflow of one measurement; nobody says which sample it is of."""
    params = {"device": str(lab.node("nmr").id), "action": "measure", "args": SHORT}
    step = {"id": "m", "kind": "device_action", "params": params, "position": {"x": 0, "y": 0}}
    document = {"schema": "labweb.workflow/1", "name": "NMR", "steps": [step], "edges": []}
    chemist = lab.people["chemist"]
    workflow = workflow_services.create_workflow(
        lab.lab, name="NMR", document=document, actor=chemist
    )
    version = workflow_services.save_version(workflow.id, note="", actor=chemist)
    return services.start_run(version, actor=chemist)


def commands(edge: Edge, server: Server) -> list[Signed]:
    """Return the commands of the outbox as the host gets them."""
    found = []
    for row in Outbox.objects.filter(host_id=edge.host_id, settled_at__isnull=True):
        if row.kind == "batch":
            draft = msgspec.convert(row.body, command_outbox.BatchDraft)
            command: Command = command_outbox.signed_batch(draft, edge.epoch, server.sign, at=now())
        else:
            command = command_outbox.stamped(
                msgspec.convert(row.body, Command), edge.epoch, at=now()
            )
        found.append(server.sign(command))
    return found


def brought(edge: Edge, config: HostConfig) -> int:
    """Carry what waits on the host to the server, frame by frame, as the uplink does."""
    waiting = WaitingFiles(config.files_path)
    for kept in waiting.waiting():
        about = {"epoch": edge.epoch, "action_id": kept.action_id, "device_id": kept.device_id}
        data, gathered = kept.path.read_bytes(), FileParts()
        told = {**about, "sha256": kept.sha256, "size_bytes": len(data)}
        assert services.offer_file(edge.host_id, msgspec.convert(told, FileOffer)) == WANTED
        parts = [
            FilePart(**told, offset_bytes=at, data=data[at : at + PART_BYTES])  # type: ignore[arg-type]
            for at in range(0, len(data), PART_BYTES)
        ]
        whole = [gathered.add(part) for part in parts][-1]
        assert whole == data
        assert services.take_file(edge.host_id, parts[-1], data) == ""
        waiting.drop(kept)
    return len(waiting.waiting())


@confining
def test_a_spectrum_comes_from_the_wire_to_the_record_of_its_sample(
    lab: tuple[Bench, str], tmp_path: Path
) -> None:
    bench, url = lab
    folder, line = tmp_path / "host", line_key(url)
    config = msgspec.structs.replace(a_config(folder), host_id=bench.host.id)
    folder.mkdir()
    create_key(Path(config.key_file))
    edge, server = Edge(bench), Server()
    edge.journal_id = create_journal(config.journal_path, edge.host_id)
    run = started(bench)

    journal = Journal(config.journal_path)
    welcome = enrollment_services.open_session(edge.hello("nonce"), "nonce")
    edge.epoch = server.epoch = welcome.epoch
    open_session(journal, msgspec.structs.replace(welcome, command_keys=server.keys))
    assert arm(journal)
    enrollment_services.resume_host(edge.host_id, edge.epoch)
    assert services.dispatch_ready() == 1
    for signed in commands(edge, server):
        accept(journal, signed, lambda _line: None)
    hang(journal.bell_path)
    (folder / f"{line_queue(line)}.lock").touch()
    config.files_of(line).mkdir(parents=True)
    (folder / "host.json").write_bytes(msgspec.json.encode(config))
    done = subprocess.run(
        [sys.executable, "-m", "tests.workers.line.line_probe", str(folder / "host.json"), line],
        cwd=ROOT, env=dict(os.environ), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr

    events = journal.events_after(0)
    assert host_events.ingest_events(edge.host_id, edge.epoch, events) is not None
    job = Job.objects.get(run=run)
    assert (job.state, job.message) == ("complete", "")
    named = job.evidence["report"]["files"]
    assert [one["name"] for one in named] == NAMES
    assert {row.state for row in Incoming.objects.all()} == {"awaited"}
    assert brought(edge, config) == 0
    for row in Incoming.objects.all():
        telemetry_services.read_incoming(row.pk)
    tube = bench.node("tube")
    for one in named:
        kept = File.objects.get(sha256=one["sha256"])
        assert (kept.job_id, kept.resource_id, kept.name) == (job.pk, tube.id, one["name"])
        assert telemetry_selectors.path_of(kept.sha256).stat().st_size == one["size_bytes"]
    spectrum = Reading.objects.get(job=job)
    assert (spectrum.resource_id, spectrum.series is not None) == (tube.id, True)
    journal.close()
