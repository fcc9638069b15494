"""An arm carries a vial under a camera: what the camera sees guards it, and confirms it.

```text
shelf ──arm──▶ bench        one camera above both; a device of it for each place
```
"""

from __future__ import annotations

import hashlib
import json
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from uuid import UUID, uuid4

import msgspec
import pytest

from drivers.load import read_spec
from drivers.sensors import network_camera
from drivers.transports.urls import line_key
from labweb.domain.crutd.operations import Read, TransferResource, to_json
from labweb.domain.crutd.pre_and_postconditions import Condition, sees_tag, sees_vessel
from labweb.domain.messages.commands import Do, ResourceView
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from tests.fixtures.hand_bench import a_document, a_vessel
from tests.fixtures.running import Process
from tests.workers.bench import HOST_ID, Server, installed, plain
from workers.base.system_clock import HostClock
from workers.base.valkey_store import ValkeyStore
from workers.journal.command_acceptance import accept
from workers.journal.journal import Journal, create_journal
from workers.line.action_files import ActionFiles
from workers.line.device_unit import DeviceUnit
from workers.line.executor import Executor
from workers.line.line_process import make_units
from workers.line.status_sampling import Sampler
from workers.uplink.session import arm as arm_host
from workers.uplink.session import open_session

ARM, SHELF_EYE, BENCH_EYE = uuid4(), uuid4(), uuid4()
VIAL, SHELF, BENCH = uuid4(), uuid4(), uuid4()
SURE = 0.9
CARRY = TransferResource(resource_id=VIAL, from_id=SHELF, to_id=BENCH)


@dataclass
class Cell:
    """An arm and a camera, a host that serves them, and the simulated bench behind."""

    process: Process
    journal: Journal
    server: Server
    devices: dict[UUID, DeviceConfig]
    files: ActionFiles
    store: ValkeyStore
    eyes: dict[UUID, DeviceUnit]
    """The camera's line: its sampler and its executor share the devices."""

    def carry(self, pre: list[Condition], post: list[Condition]) -> dict[str, Any]:
        """Have the arm carry the vial from shelf to bench; return how it ended."""
        args = {"program": "fetch.urp"}
        return self.run(ARM, "run_program", args, to_json(CARRY), pre, post)

    def look(self, post: list[Condition]) -> dict[str, Any]:
        read = to_json(Read(device_id=SHELF_EYE, statuses=("sighting",)))
        return self.run(SHELF_EYE, "look", {}, read, [], post)

    def run(
        self,
        device_id: UUID,
        action: str,
        args: dict[str, Any],
        operation: dict[str, Any],
        pre: list[Condition],
        post: list[Condition],
    ) -> dict[str, Any]:
        device = self.devices[device_id]
        do = Do(
            host_id=HOST_ID, epoch=self.server.epoch, dseq=self.server.next_dseq(),
            action_id=uuid4(), job_id=uuid4(), run_id=uuid4(), attempt=1, line="",
            device_id=device_id, driver_digest=device.digest, action=action, args=args,
            operation=operation, pre=[plain(one) for one in pre],
            post=[plain(one) for one in post], timeout_s=20.0,
            resources=[
                ResourceView(id=VIAL, name="vial", kind="vial", rev=1, parent_id=SHELF),
                ResourceView(id=SHELF, name="shelf", kind="slot", rev=1),
                ResourceView(id=BENCH, name="bench", kind="slot", rev=1),
            ],
        )  # fmt: skip
        accept(self.journal, self.server.sign(do), lambda _line: None)
        line = line_key(device.transport)
        own = {} if device_id in self.eyes else make_units([device], HostClock(), installed())
        units = own or self.eyes
        executor = Executor(
            self.journal, line, units,
            store=self.store, clock=HostClock(), files=self.files,
        )  # fmt: skip
        for unit in units.values():
            unit.connect_if_due()
            assert unit.is_online
        try:
            executor.drain()
        finally:
            executor.close()
            for unit in own.values():
                unit.close()
        last = [one for one in self.journal.events_after(0) if one.action_id == do.action_id][-1]
        return {"kind": last.kind, "action_id": do.action_id, **last.body}

    def standing(self) -> dict[str, str]:
        return dict(self.process.get("/world")["standing"])

    def inflict(self, instrument: str, fault: str, **options: object) -> None:
        path = f"/instruments/{instrument}/faults"
        status, answer = self.process.call("POST", path, {"fault": fault, **options})
        assert status == 201, answer


def a_device(device_id: UUID, key: str, module: str, url: str, **config: Any) -> DeviceConfig:  # noqa: ANN401
    spec = read_spec(module)
    statuses = {"sighting": 0.2} if key.endswith("eye") else {}
    return DeviceConfig(
        id=device_id, key=key, name=key, module=module, class_name=spec.class_name,
        digest=spec.digest, transport=url, config=config, statuses=statuses, nodes={},
    )  # fmt: skip


@pytest.fixture
def bench() -> Iterator[Process]:
    with TemporaryDirectory(prefix="lw") as name:
        folder = Path(name)
        end = {"endpoint": "tcp:127.0.0.1:0"}
        eye = {"id": "eye", "model": "network_camera", "settings": {"places": "shelf;bench"}}
        arm = {
            "id": "arm",
            "model": "ur_dashboard",
            "settings": {
                "programs": "fetch.urp",
                "carries": "fetch.urp:shelf>bench",
                "program_s": 3.0,
            },
        }
        vial = a_vessel("vial", 1000.0) | {"place": "shelf", "tag": "VIAL-7"}
        document = a_document({**eye, **end}, {**arm, **end}, vessels=[vial])
        (folder / "bench.json").write_text(json.dumps(document))
        process = Process(folder)
        process.start()
        with socket.create_connection(("127.0.0.1", process.port_of("arm"))) as pendant:
            pendant.sendall(b"brake release\n")
            while process.get("/instruments/arm")["state"]["mode"] != "RUNNING":
                time.sleep(0.05)
        yield process
        process.stop()


@pytest.fixture
def cell(
    bench: Process, store: ValkeyStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Cell]:
    """Serve arm and camera; the camera's line samples on a thread, as its process does."""
    monkeypatch.setattr(network_camera, "ANSWER_S", 3.0)
    eye_url = f"http://127.0.0.1:{bench.port_of('eye')}"
    places = {"width_ratio": 0.5, "max_age_s": 2.0}
    camera, arm = "drivers.sensors.network_camera", "drivers.logistics.ur_dashboard"
    made = [
        a_device(
            ARM, "arm", arm, f"tcp://127.0.0.1:{bench.port_of('arm')}", programs=["fetch.urp"]
        ),
        a_device(SHELF_EYE, "shelf_eye", camera, eye_url, place_tag="shelf", **places),
        a_device(
            BENCH_EYE, "bench_eye", camera, eye_url, place_tag="bench", left_ratio=0.5, **places
        ),
    ]
    path = tmp_path / "journal.sqlite3"
    create_journal(path, HOST_ID)
    journal, server = Journal(path), Server()
    open_session(journal, server.welcome(*made))
    assert arm_host(journal)
    units = make_units(made[1:], HostClock(), installed())
    sampler = Sampler(line_key(eye_url), units, store, HostClock())
    sampler.start()
    deadline_s = time.monotonic() + 20
    while any(store.latest(one, "sighting") is None for one in (SHELF_EYE, BENCH_EYE)):
        assert time.monotonic() < deadline_s, "the camera tells nothing"
        time.sleep(0.05)
    devices = {one.id: one for one in made}
    yield Cell(
        bench, journal, server, devices, ActionFiles(tmp_path / "files" / "line"), store, units
    )
    sampler.stop()
    for unit in units.values():
        unit.close()


GUARD = [sees_tag(SHELF_EYE, "VIAL-7", min_confidence=SURE)]
CONFIRM = [sees_tag(BENCH_EYE, "VIAL-7", min_confidence=SURE, timeout_s=10.0)]


def test_a_carry_that_the_camera_saw_is_sensed_and_its_pictures_are_kept(cell: Cell) -> None:
    ended = cell.carry(GUARD, CONFIRM)
    assert (ended["kind"], ended["verification"]) == ("complete", "sensed")
    assert ended["change"]["moves"] == {str(VIAL): str(BENCH)}
    assert cell.standing() == {"bench": "vial"}
    evidence = ended["post"][0]["evidence"]
    assert evidence["camera_id"] == str(BENCH_EYE)
    assert evidence["confidence"] >= SURE
    kept = {one.sha256: one for one in cell.files.waiting()}
    assert len(kept) == 2, "one before, one after"
    picture = kept[evidence["image_sha256"]]
    assert hashlib.sha256(picture.path.read_bytes()).hexdigest() == evidence["image_sha256"]
    assert (picture.action_id, picture.device_id) == (ended["action_id"], BENCH_EYE)


@pytest.mark.parametrize(
    "guard",
    [
        sees_tag(SHELF_EYE, "VIAL-8", min_confidence=SURE),
        sees_vessel(SHELF_EYE, is_present=False, min_confidence=SURE),
        sees_tag(BENCH_EYE, "VIAL-7", min_confidence=SURE),
    ],
    ids=["wrong tag", "a vessel where none should be", "no vessel there"],
)
def test_a_carry_is_refused_when_the_camera_sees_something_else(
    cell: Cell, guard: Condition
) -> None:
    ended = cell.carry([guard], CONFIRM)
    assert (ended["kind"], ended["code"]) == ("rejected", guard.name)
    assert ended["pre"][0]["verdict"] == "fail"
    assert cell.standing() == {"shelf": "vial"}
    assert cell.process.get("/instruments/arm/actuations?since=0") == []


def test_a_carry_is_refused_in_the_dark(cell: Cell) -> None:
    cell.inflict("eye", "dark", ratio=0.1)
    time.sleep(1.5)
    ended = cell.carry(GUARD, CONFIRM)
    assert ended["kind"] == "rejected"
    assert ended["pre"][0]["verdict"] == "unobservable"
    assert cell.standing() == {"shelf": "vial"}


def test_a_camera_that_goes_dead_after_the_guard_leaves_the_vial_in_doubt(cell: Cell) -> None:
    soon = [sees_tag(BENCH_EYE, "VIAL-7", min_confidence=SURE, timeout_s=1.0)]
    blind = [*GUARD, Condition(name="arm.idle", device_id=ARM, status="is_running", equals=False)]
    cell.inflict("eye", "power_loss", for_s=1000.0)
    ended = cell.carry(blind, soon)
    assert (ended["kind"], ended["code"], ended["verification"]) == (
        "in_doubt", "camera.tag", "assumed",
    )  # fmt: skip
    assert str(VIAL) in ended["change"]["quarantined"]
    assert ended["post"][0]["verdict"] == "unobservable"


def test_a_look_that_must_pass_ends_there_when_it_does_not(cell: Cell) -> None:
    tag = sees_tag(SHELF_EYE, "VIAL-7", min_confidence=SURE)
    seen = cell.look([tag])
    assert (seen["kind"], seen["verification"]) == ("complete", "sensed")
    reported = seen["report"]["evidence"]["sighting"]["image_sha256"]
    assert reported in {one.sha256 for one in cell.files.waiting()}
    other = cell.look([msgspec.structs.replace(tag, equals="VIAL-8")])
    assert (other["kind"], other["code"]) == ("aborted", "camera.tag")
    cell.inflict("eye", "dark", ratio=0.1)
    dark = cell.look([tag])
    assert (dark["kind"], dark["code"]) == ("aborted", "camera.tag")
    assert dark["change"]["quarantined"] == []


def test_an_arm_that_grips_nothing_is_found_out(cell: Cell) -> None:
    cell.inflict("arm", "slip")
    soon = [sees_tag(BENCH_EYE, "VIAL-7", min_confidence=SURE, timeout_s=1.0)]
    ended = cell.carry(GUARD, soon)
    assert (ended["kind"], ended["code"]) == ("in_doubt", "camera.tag")
    assert ended["post"][0]["verdict"] == "fail"
    assert cell.standing() == {"shelf": "vial"}
