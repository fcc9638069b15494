"""A disk that fills up, or can only be read, and processes that may open no more files.

Nothing dies for good, nothing acts that is not on record, the page says what is the matter, and
with room the lab goes on by itself: each motion happens once, by the instruments' own count.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import httpx
import psycopg
import pytest
from redis import Redis
from redis.exceptions import ResponseError

from deploy.embedded import procfs
from deploy.embedded.layout import CHECKOUT
from tests.deploy.small_disk import SmallDisk, failing_disk, no_more_files, small_disk
from tests.system.outages import (
    Outage,
    an_outage,
    broker_sockets,
    conninfo,
    database_answers,
    database_url,
    host_pids,
)
from tests.system.stack import Stack, is_over, running

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(240),
    pytest.mark.skipif(os.geteuid() != 0, reason="only root may mount a small disk"),
]

FLOORS = {
    "LABWEB_DISK_WARN_MB": "100",
    "LABWEB_DISK_WARN_PERCENT": "5",
    "LABWEB_DISK_FLOOR_MB": "40",
    # Named points look for a file whenever they are passed, and may then open none.
    "LABWEB_FAULTS": "0",
}
IS_SOAK = bool(os.environ.get("LABWEB_SOAK"))
FULL_S = 60.0 if IS_SOAK else 5.0
"""How long there is no room; an outcome that was given up after 30 s would be in doubt."""

BACK_WITHIN_S = 30.0

WHOSE = ("the server", "Host 1")


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    """Give a folder with a short path."""
    found = Path(tempfile.mkdtemp(prefix="lf-", dir="/tmp"))
    yield found
    shutil.rmtree(found, ignore_errors=True)


@pytest.fixture(scope="module")
def disk(folder: Path) -> Iterator[SmallDisk]:
    """Mount a small disk."""
    (folder / "disk").mkdir()
    with small_disk(folder / "disk") as found:
        yield found


@pytest.fixture(scope="module")
def lab(disk: SmallDisk) -> Iterator[Stack]:
    """Start a whole lab with all that it has on the small disk."""
    with running(disk.folder / "lab", embedded=True, variables=FLOORS) as found:
        yield found


@pytest.fixture
def stack(lab: Stack, disk: SmallDisk) -> Iterator[Stack]:
    """Lend the lab, and give it room again, of which server and host then know.

    What a test has left under way ends before the next one counts strokes.
    """
    yield lab
    disk.clear()
    _wait_until(lambda: _health(lab)["disk"] == "ok" and _host(lab)["disk"]["level"] == "ok")
    _wait_until(lambda: all(map(is_over, lab.client().get("runs")["runs"])), 90.0)


def _wait_until(is_so: Callable[[], bool], within_s: float = BACK_WITHIN_S) -> None:
    deadline_s = time.monotonic() + within_s
    while not is_so():
        assert time.monotonic() < deadline_s
        time.sleep(0.1)


def _told_of_list(stack: Stack, end: str) -> int:
    """Return how often the supervisor has said so of its list; a short one may still fit."""
    said = stack._said.read_text().splitlines()
    return sum("The list of processes" in line and end in line for line in said)


def _health(stack: Stack) -> dict[str, Any]:
    found: dict[str, Any] = httpx.get(f"{stack.url}healthz", timeout=30).json()
    return found


def _host(stack: Stack) -> dict[str, Any]:
    found: dict[str, Any] = stack.client().get("hosts")["hosts"][0]
    return found


def _warnings(stack: Stack) -> list[dict[str, Any]]:
    needs = stack.client().get("home")["needs_you"]
    return [need for need in needs if need["kind"] == "disk"]


def _runs(stack: Stack, name: str) -> bool:
    return any(name in line for line in stack.command_lines())


def _ends_by_itself(outage: Outage) -> None:
    """See a run complete without a person, and each motion once."""
    seen = outage.stack.client().wait_for_run(outage.id, is_over, 90.0)
    states = [(job["action"], job["state"], job["message"]) for job in seen["jobs"]]
    assert seen["state"] == "complete", states
    outage.judge()


def test_too_little_room_is_told_of_and_no_run_is_started(stack: Stack, disk: SmallDisk) -> None:
    assert _health(stack) == {"ok": True, "disk": "ok"}
    assert _warnings(stack) == []
    disk.fill(but_mb=70)
    # The disk of the server is that of the host; the database takes and gives room meanwhile.
    _wait_until(
        lambda: (
            [need["title"] for need in _warnings(stack)]
            == [f"The disk of {whose} has {disk.left_mb()} MB left" for whose in WHOSE]
        )
    )
    server, host = _warnings(stack)
    assert server["detail"].startswith("Runs are not started below 42 MB. Free some space")
    assert host["url"].startswith("/hosts/")
    assert _health(stack) == {"ok": True, "disk": "low"}
    with an_outage(stack):
        pass

    disk.fill(but_mb=20)
    _wait_until(lambda: _health(stack)["disk"] == "full")
    version = stack.client().draw_step("wait", {"duration": "1 s"})
    refused = stack.client().raw("POST", "runs", {"version_id": version, "is_second": True})
    assert (refused.status_code, refused.json()["code"]) == (412, "run.disk_full")
    assert "no run is started below" in refused.json()["message"]
    _wait_until(lambda: _host(stack)["disk"]["level"] == "full")
    _wait_until(
        lambda: _host(stack)["disk"]["text"].startswith(
            f"The disk of Host 1 has {disk.left_mb()} MB left. No run is "
        )
    )
    status = [sys.executable, "-m", "deploy.embedded", "status", "--data", str(stack.data)]
    said = subprocess.run(
        status, cwd=CHECKOUT, env=os.environ | FLOORS, capture_output=True, text=True, check=True
    )
    assert "no run is started below" in said.stdout

    disk.clear()
    _wait_until(lambda: _health(stack)["disk"] == "ok" and _warnings(stack) == [])
    stack.client().start_version(version)


def test_a_disk_that_is_full_in_mid_stroke_ends_no_lab(stack: Stack, disk: SmallDisk) -> None:
    """The supervisor has to start a process meanwhile, and to write down that it did."""
    bench = stack.pid("fixtures.instruments")
    outage = Outage(stack)
    outage.wait_until_moving()
    disk.fill()
    stack.kill("dispatcher")
    # The server asks for its disk once a second.
    _wait_until(lambda: _runs(stack, "dispatcher") and _health(stack)["disk"] == "full")
    began_s = time.monotonic()
    while time.monotonic() - began_s < FULL_S:
        assert stack.process.poll() is None
        assert _health(stack)["disk"] == "full"
        time.sleep(0.5)
    disk.clear()
    _ends_by_itself(outage)
    assert stack.pid("fixtures.instruments") == bench, "the simulated bench has ended"
    _wait_until(
        lambda: _told_of_list(stack, "written now") == _told_of_list(stack, "written again")
    )


def test_a_database_that_finds_no_room_starts_again_when_there_is(
    stack: Stack, disk: SmallDisk
) -> None:
    """It ends in a panic where it cannot begin the next part of its log."""
    outage = Outage(stack)
    outage.wait_until_moving()
    disk.fill()
    _use_up_log(stack)
    _wait_until(lambda: not database_answers(stack))
    time.sleep(1.5)  # the server asks for its disk once a second
    answer = stack.client().raw("GET", "runs")
    assert (answer.status_code, answer.json()["code"]) == (503, "http.disk_full")
    assert "Free some space" in answer.json()["message"]
    assert httpx.get(f"{stack.url}healthz", timeout=30).status_code == 503
    time.sleep(FULL_S)
    assert stack.process.poll() is None
    disk.clear()
    began_s = time.monotonic()
    _wait_until(lambda: database_answers(stack))
    assert time.monotonic() - began_s < 5.0, "it was not started as soon as there was room"
    _ends_by_itself(outage)
    said = [one for one in stack._said.read_text().splitlines() if "postgresql ended" in one]
    assert len(said) == 1, said
    assert "it starts by itself once the disk has room" in said[0]


def _use_up_log(stack: Stack) -> None:
    owner = conninfo(database_url(stack).replace("//labweb_app@", "//labweb@", 1))
    fill = "CREATE TEMP TABLE filling (n int); DROP TABLE filling"
    with suppress(psycopg.Error), psycopg.connect(owner, autocommit=True) as connection:
        for _ in range(60):
            connection.execute(fill)
            connection.execute("SELECT pg_switch_wal()")


def test_a_broker_that_finds_no_room_rings_again_when_there_is(
    stack: Stack, disk: SmallDisk
) -> None:
    """It refuses every write, and every question whether it is there."""
    outage = Outage(stack)
    outage.wait_until_moving()
    disk.fill()
    with Redis(unix_socket_path=str(broker_sockets(stack)[0])) as broker:

        def refuses() -> bool:
            try:
                broker.set("filling", b"x" * 100_000)
                broker.ping()
            except ResponseError as error:
                return "MISCONF" in str(error)
            return False

        _wait_until(refuses)
        time.sleep(FULL_S)
        assert stack.process.poll() is None
        disk.clear()
        _wait_until(lambda: not refuses())
        broker.delete("filling")
    _ends_by_itself(outage)
    _wait_until(lambda: _runs(stack, "labweb.*worker") or _runs(stack, " worker -Q server"))


def test_processes_that_may_open_no_more_files_go_on_when_they_may(stack: Stack) -> None:
    """Of the host and of web, in mid-stroke: what cannot be written down first is not begun."""
    web, host = stack.pid("uvicorn"), stack.pid("workers.host --config")
    with an_outage(stack), no_more_files([web, *host_pids(stack)]):
        time.sleep(FULL_S)
    assert (stack.pid("uvicorn"), stack.pid("workers.host --config")) == (web, host)


def test_lines_that_are_killed_on_a_full_disk_start_again_before_there_is_room(
    stack: Stack, disk: SmallDisk
) -> None:
    """Nobody else halts their devices; their log takes no word of theirs.

    The last one of this lab: a halted stroke is left for a person.
    """
    outage = Outage(stack, "0.4 mL/min")  # it is still in its stroke when its line is killed
    outage.wait_until_moving()
    disk.fill()
    disk.fill_page_of(stack.data / "logs" / "edge-host.log")
    killed = _lines(stack)
    for pid in killed:
        os.kill(pid, signal.SIGKILL)
    _wait_until(lambda: len(set(_lines(stack)) - set(killed)) == len(killed))
    time.sleep(FULL_S)
    assert len(set(_lines(stack)) - set(killed)) == len(killed)
    disk.clear()
    seen = stack.client().wait_for_run(outage.id, is_over, 60.0)
    assert [job["state"] for job in seen["jobs"]].count("in_doubt") == 1, "nobody is asked"
    assert outage.strokes().count("aspirate") == 1


def _lines(stack: Stack) -> list[int]:
    """Find the processes of the lines with pumps."""
    found = []
    for pid in host_pids(stack):
        with suppress(FileNotFoundError):
            words = Path(f"/proc/{pid}/cmdline").read_bytes().decode()
            if "workers.host.process_main line" in words.replace("\0", " ") and "serial:" in words:
                found.append(pid)
    return found


def test_a_disk_that_can_only_be_read_ends_no_process_that_acts(folder: Path) -> None:
    """The kernel takes it for damaged, as on a real fault; only a new mount ends that."""
    (folder / "e").mkdir()
    with (
        failing_disk(folder / "e", folder / "image") as trigger,
        running(folder / "e" / "lab", embedded=True, variables=FLOORS) as stack,
    ):
        outage = Outage(stack)
        outage.wait_until_moving()
        kept = {
            name: procfs.identify(stack.pid(name))
            for name in ("uvicorn", "workers.host --config", "fixtures.instruments")
        }
        trigger.write_text("x")
        time.sleep(0.2)
        begun = _begun(stack)
        assert len(begun) > len(outage.strokes()) - 1
        time.sleep(FULL_S)
        assert stack.process.poll() is None
        assert {one: process and procfs.is_alive(process) for one, process in kept.items()} == (
            dict.fromkeys(kept, True)
        )
        assert _health(stack)["disk"] == "full"
        assert _begun(stack) == begun, "something acts that is not on record"


def _begun(stack: Stack) -> list[int]:
    """Number what the pumps have begun, as they remember it: their files cannot be written."""
    with stack.instruments() as control:
        answers = [
            control.get(f"instruments/{pump}/actuations", params={"since": 0}).json()
            for pump in ("pump_1", "pump_2")
        ]
    return [one["n"] for answer in answers for one in answer]
