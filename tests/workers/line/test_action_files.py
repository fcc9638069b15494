"""A spectrometer hands its files over: they are on the host's disk before the action counts."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, cast
from uuid import UUID, uuid4

import msgspec
import pytest

from drivers.base import DataFile, Report
from drivers.load import read_spec
from drivers.transports.urls import line_key
from labweb.domain import action_files as handed
from labweb.domain.crutd.operations import Read, Update, to_json
from labweb.domain.errors import StateError
from labweb.domain.messages.commands import Do, ResourceView
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from tests.drivers.conformance.placed_models import a_free_port
from tests.fixtures.hand_bench import a_document, a_vessel
from tests.fixtures.running import Process
from tests.workers.bench import HOST_ID, Server, environment, installed
from tests.workers.sandbox.test_confinement import a_config, confining
from workers.base.config import line_queue
from workers.base.host_key import create_key
from workers.base.system_clock import HostClock
from workers.journal.command_acceptance import accept
from workers.journal.journal import Journal, create_journal
from workers.line import action_files as files_module
from workers.line.action_execution import to_report
from workers.line.action_files import ActionFiles, WaitingFiles
from workers.line.executor import Executor
from workers.line.line_process import make_units
from workers.uplink.session import arm as arm_host
from workers.uplink.session import open_session

NMR, TUBE, BORE = uuid4(), uuid4(), uuid4()
MODULE = "drivers.characterization.magritek_spinsolve"
SHORT: dict[str, Any] = {
    "sample": "a1",
    "solvent": "CDCl3",
    "scan_count": 1,
    "acquisition_s": 0.8,
    "repetition_s": 2.0,
    "pulse_angle_deg": 90.0,
}
NAMES = ["acqu.par", "data.1d", "spectrum_processed.1d", "spectrum.dx"]
READ = to_json(Read(device_id=BORE, sample_id=TUBE))


@pytest.fixture(scope="module")
def bench() -> Iterator[tuple[Process, int]]:
    """Run a spectrometer that shares its folder, with a tube in its bore."""
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
        yield process, port
        process.stop()


def a_spectrometer(process: Process, port: int) -> DeviceConfig:
    """Return the device as a host is told of it."""
    spec = read_spec(MODULE)
    return DeviceConfig(
        id=NMR,
        key="nmr",
        name="NMR",
        module=MODULE,
        class_name=spec.class_name,
        digest=spec.digest,
        transport=f"tcp://127.0.0.1:{process.port_of('nmr')}?share={port}",
        config={"data_root": process.get("/instruments/nmr")["state"]["data_root"]},
        statuses={},
        nodes={},
    )


@dataclass
class Cell:
    """A host with one line, that of the spectrometer."""

    process: Process
    device: DeviceConfig
    folder: Path
    server: Server = field(default_factory=Server)

    def __post_init__(self) -> None:
        create_journal(self.folder / "journal.sqlite3", HOST_ID)
        self.journal = Journal(self.folder / "journal.sqlite3")
        open_session(self.journal, self.server.welcome(self.device))
        assert arm_host(self.journal)
        self.files = ActionFiles(self.folder / "files" / "line")

    def measure(self, operation: dict[str, Any] = READ) -> dict[str, Any]:
        """Take a spectrum; return how the action ended."""
        do = Do(
            host_id=HOST_ID, epoch=self.server.epoch, dseq=self.server.next_dseq(),
            action_id=uuid4(), job_id=uuid4(), run_id=uuid4(), attempt=1, line="",
            device_id=NMR, driver_digest=self.device.digest, action="measure", args=SHORT,
            operation=operation, pre=[], post=[], timeout_s=60.0,
            resources=[
                ResourceView(id=BORE, name="bore", kind="workstation", rev=1),
                ResourceView(id=TUBE, name="tube", kind="vial", rev=1, parent_id=BORE),
            ],
        )  # fmt: skip
        accept(self.journal, self.server.sign(do), lambda _line: None)
        units = make_units([self.device], HostClock(), installed())
        made = Executor(
            self.journal, line_key(self.device.transport), units,
            store=None, clock=HostClock(), files=self.files,
        )  # fmt: skip
        for unit in units.values():
            unit.connect_if_due()
            assert unit.is_online
        try:
            made.drain()
        finally:
            made.close()
            for unit in units.values():
                unit.close()
        last = [one for one in self.journal.events_after(0) if one.action_id == do.action_id][-1]
        return {"kind": last.kind, "action_id": do.action_id, **last.body}


@pytest.fixture
def cell(bench: tuple[Process, int], tmp_path: Path) -> Iterator[Cell]:
    process, port = bench
    made = Cell(process, a_spectrometer(process, port), tmp_path)
    yield made
    process.call("DELETE", "/instruments/nmr/faults")
    made.journal.close()


def test_what_was_measured_lies_on_disk_as_the_record_names_it(cell: Cell) -> None:
    ended = cell.measure()
    assert (ended["kind"], ended["message"]) == ("complete", "")
    named = ended["report"]["files"]
    assert [one["name"] for one in named] == NAMES
    assert named[-1]["format"] == "jcamp"
    folder = Path(ended["report"]["evidence"]["data_folder"])
    waiting = {one.sha256: one for one in cell.files.waiting()}
    assert len(waiting) == len(named)
    for one in named:
        written = (folder / one["name"]).read_bytes()
        assert (hashlib.sha256(written).hexdigest(), len(written)) == (
            one["sha256"], one["size_bytes"],
        )  # fmt: skip
        kept = waiting[one["sha256"]]
        assert kept.path.read_bytes() == written
        assert (kept.action_id, kept.device_id) == (ended["action_id"], NMR)


def test_a_damaged_file_is_no_spectrum_and_nothing_of_it_is_kept(cell: Cell) -> None:
    status, _ = cell.process.call("POST", "/instruments/nmr/faults", {"fault": "truncated"})
    assert status == 201
    ended = cell.measure()
    assert (ended["kind"], ended["code"]) == ("aborted", "device.frame")
    assert "ends in the middle" in ended["message"] or "points take" in ended["message"]
    assert "files" not in ended["report"]
    assert cell.files.waiting() == []


@pytest.mark.parametrize(
    ("limit", "value", "code"),
    [
        ((handed, "MOST_BYTES"), 5000, "file.too_large"),
        ((handed, "MOST_FILES"), 2, "file.too_many"),
        ((files_module, "MOST_WAITING"), 2, "file.no_room"),
        ((files_module, "MOST_WAITING_BYTES"), 5000, "file.no_room"),
        ((files_module, "RESERVE_BYTES"), 2**60, "file.no_room"),
    ],
)
def test_what_is_too_much_is_refused_whole(
    cell: Cell,
    limit: tuple[Any, str],
    value: int,
    code: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(*limit, value)
    ended = cell.measure()
    assert (ended["kind"], ended["code"]) == ("aborted", code)
    assert "files" not in ended["report"]
    assert list((cell.folder / "files" / "line").iterdir()) == [], "nothing of it, and no half"


def test_an_action_that_changes_something_is_in_doubt_when_its_files_are_lost(
    cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(handed, "MOST_FILES", 1)
    ended = cell.measure(to_json(Update(resource_id=BORE, data={})))
    assert (ended["kind"], ended["code"]) == ("in_doubt", "file.too_many")


def test_a_disk_that_refuses_ends_the_action_and_leaves_no_half_file(
    cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_handle: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(StateError) as refusal:
            cell.files.keep(uuid4(), NMR, hashlib.sha256(b"x").hexdigest(), b"x")
    assert refusal.value.code == "file.no_room"
    assert list((cell.folder / "files" / "line").iterdir()) == []


def test_what_a_crash_left_half_written_is_cleared_and_what_is_whole_stays(tmp_path: Path) -> None:
    data, folder = b"whole", tmp_path / "files" / "line"
    ActionFiles(folder).keep(uuid4(), NMR, hashlib.sha256(data).hexdigest(), data)
    (folder / ".half").write_bytes(b"wh")
    again = ActionFiles(folder)
    assert [one.path.read_bytes() for one in again.waiting()] == [data]
    assert [path.name for path in folder.iterdir() if path.name.startswith(".")] == []
    assert len(WaitingFiles(tmp_path / "files").waiting()) == 1


def test_a_stray_name_does_not_hide_the_files_that_wait(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    data, folder = b"whole", tmp_path / "files" / "line"
    files = ActionFiles(folder)
    (folder / "a.b.c").write_bytes(b"x")
    (folder / "README").write_bytes(b"x")
    files.keep(uuid4(), NMR, hashlib.sha256(data).hexdigest(), data)
    for _ in range(2):
        assert [one.path.read_bytes() for one in files.waiting()] == [data]
        assert len(WaitingFiles(folder.parent).waiting()) == 1
    assert len(caplog.records) == 2, "each is told once"


def test_files_that_cannot_be_are_found(cell: Cell) -> None:
    def named(
        name: str = "a", form: str = "none", size: int = 1, sha: str = "", kind: str = "text/csv"
    ) -> Any:  # noqa: ANN401
        return handed.NamedFile(
            name=name, format=form, media_type=kind, size_bytes=size, sha256=sha or uuid4().hex * 2
        )

    wrong = [named(form="pdf"), named(""), named("a/b"), named("b", size=0)]
    wrong += [named("c", size=handed.MOST_BYTES + 1)]
    wrong += [named("d", sha="1" * 64), named("e", sha="1" * 64)]
    wrong += [named("f", kind=""), named("g", kind="text/" + "c" * 100), named("h", size=-1)]
    wrong += [named("i", sha="1"), named("j", sha="A" * 64)]
    found = [one.code for one in handed.check_files(wrong)]
    assert sorted(found) == sorted(
        [
            "file.twice", "file.format", "file.name", "file.name", "file.empty", "file.too_large",
            "file.media_type", "file.media_type", "file.empty", "file.digest", "file.digest",
        ]
    )  # fmt: skip
    assert handed.check_files([named("a"), named("b")]) == []
    assert DataFile(name="a", format="none", data=b"x").sha256 == hashlib.sha256(b"x").hexdigest()


def test_a_file_whose_device_tells_an_odd_media_type_is_named_all_the_same(cell: Cell) -> None:
    do = SimpleNamespace(operation=READ, corrections=())
    told = ["text/" + "c" * 200, "what it measured", "Chemical/X-JCAMP-DX; version=4", "text/csv"]
    made = tuple(
        DataFile(name=f"{place}", format="none", data=kind.encode(), media_type=kind)
        for place, kind in enumerate(told)
    )
    units = make_units([cell.device], HostClock(), installed())
    named = to_report(cast("Do", do), units[NMR], Report(files=made)).files
    assert [one.media_type for one in named] == [
        "application/octet-stream", "application/octet-stream", "chemical/x-jcamp-dx", "text/csv",
    ]  # fmt: skip


@confining
def test_a_confined_line_hands_its_files_over(cell: Cell, tmp_path: Path) -> None:
    """The line's process reaches its own folder of files, the instrument and its share."""
    config = a_config(tmp_path)
    create_key(Path(config.key_file))
    line = line_key(cell.device.transport)
    (config.folder / f"{line_queue(line)}.lock").touch()
    config.files_of(line).mkdir(parents=True)
    config.files_of("tcp:127.0.0.1:1").mkdir(parents=True)
    path = tmp_path / "host.json"
    path.write_bytes(msgspec.json.encode(config))
    words = [str(path), line, msgspec.json.encode(cell.device).decode(), json.dumps(SHORT)]
    done = subprocess.run(
        [sys.executable, "-m", "tests.workers.line.files_probe", *words],
        cwd=Path(__file__).parents[3],
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told == {"kept": 4, "another line's files": False, "beside them": False}
    waiting = WaitingFiles(config.files_path).waiting()
    assert len(waiting) == 4
    assert {one.device_id for one in waiting} == {NMR}
    assert {type(one.action_id) for one in waiting} == {UUID}
