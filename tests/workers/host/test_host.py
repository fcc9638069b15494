"""A whole edge host as real processes, against a server of the test."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import msgspec
import pytest
from celery import Celery

from labweb.domain.messages.commands import Command, Reset
from labweb.domain.messages.stops import StopLabFrame
from tests.workers.bench import (
    DEVICE_ID,
    HOST_ID,
    ROOT,
    PumpProcess,
    Server,
    a_device,
    a_do,
    environment,
    until,
)
from tests.workers.hub import Hub
from workers.base.celery_apps import ACCEPT
from workers.base.config import HostConfig, ValkeyConfig, command_queue
from workers.base.host_key import create_key
from workers.sandbox import confinement


class Running:
    """One supervisor process and the server it talks to."""

    def __init__(self, folder: Path, broker_url: str, hub: Hub, key: Path) -> None:
        self.hub = hub
        self.config = HostConfig(
            host_id=HOST_ID,
            name="bench",
            server_url=hub.url,
            broker_url=broker_url,
            data_dir=str(folder / "data"),
            key_file=str(key),
            valkey=ValkeyConfig(socket=str(folder / "v")),
        )
        self.file = folder / "host.json"
        self.log = folder / "host.log"
        self.changes: dict[str, str] = {}
        self.celery = Celery("server", broker=broker_url, set_as_current=False, fixups=[])
        self.popen: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        self.file.write_bytes(msgspec.json.encode(self.config))
        with self.log.open("ab") as stream:
            self.popen = subprocess.Popen(
                [sys.executable, "-m", "workers.host", "--config", str(self.file)],
                cwd=ROOT,
                env=environment(**self.changes),
                stdout=stream,
                stderr=subprocess.STDOUT,
            )

    def stop(self) -> float:
        assert self.popen is not None
        began_s = time.monotonic()
        self.popen.terminate()
        try:
            self.popen.wait(15)
        finally:
            self.popen.kill()
        return time.monotonic() - began_s

    def post(self, command: Command) -> None:
        """Publish through the broker, as the server's relay does."""
        queue = command_queue(HOST_ID)
        signed = msgspec.to_builtins(self.hub.server.sign(command))
        self.celery.send_task(ACCEPT, args=[signed], queue=queue)

    def is_online(self) -> bool:
        return any(
            one[0] == str(DEVICE_ID) for frame in self.hub.telemetry for one in frame.samples
        )


@pytest.fixture
def running(
    valkey_socket: Path, pump: PumpProcess, request: pytest.FixtureRequest
) -> Iterator[Running]:
    with tempfile.TemporaryDirectory(prefix="eh") as name:
        folder = Path(name)
        key = create_key(folder / "host.key")
        hub = Hub(Server(), [a_device(pump.url)], key.public_base64)
        broker = f"redis+socket://{valkey_socket}?virtual_host=3"
        with hub.open():
            made = Running(folder, broker, hub, folder / "host.key")
            fault = getattr(request, "param", None)
            if fault is not None:
                marker = str(folder / "once")
                made.config = msgspec.structs.replace(made.config, faults=fault)
                made.changes = {"LABWEB_FAULT_ONCE": marker}
            made.start()
            try:
                yield made
            finally:
                made.stop()
                sys.stdout.write(made.log.read_text())


def test_a_command_from_the_broker_is_carried_out_and_told(
    running: Running, pump: PumpProcess
) -> None:
    until(running.is_online, within_s=60)
    do = a_do(running.hub.server)
    running.post(do)
    until(lambda: "complete" in running.hub.kinds)
    before = ["boot", "link_lost", "armed"]
    assert running.hub.kinds == [*before, "accepted", "started", "actuated", "complete"]
    assert pump.moves == ["A300"]
    late_s = [
        running.hub.received_s[seq] - event.at_s for seq, event in running.hub.events.items()
    ][len(before) :]
    assert max(late_s) < 0.5
    assert running.stop() < 3.0


@pytest.mark.parametrize("running", ["uplink.after_send:kill"], indirect=True)
def test_nothing_is_lost_or_done_twice_when_processes_are_killed(
    running: Running, pump: PumpProcess
) -> None:
    """The uplink dies between sending and its acknowledgement; then all are killed at once."""
    hub = running.hub
    until(running.is_online, within_s=60)
    first = a_do(hub.server)
    running.post(first)
    running.post(first)
    until(lambda: hub.kinds.count("complete") == 1)
    count = len(hub.hellos)
    assert count == 2
    for child in _children(running, "uplink", "accept", "line"):
        os.kill(child, signal.SIGKILL)
    until(lambda: len(hub.hellos) == count + 1, within_s=60)
    second = msgspec.structs.replace(a_do(hub.server), resources=[])
    running.post(second)
    hub.nudge(hub.server.sign(second))
    until(lambda: hub.kinds.count("complete") == 2, within_s=60)
    assert pump.moves == ["A300", "A600"]
    assert hub.hellos[-1].seq_head >= hub.hellos[-1].acked_seq > 0
    assert hub.kinds.count("accepted") == 2


def test_stop_halts_a_running_action_at_once_and_only_a_reset_frees_the_lab(
    running: Running, pump: PumpProcess
) -> None:
    hub = running.hub
    until(running.is_online, within_s=60)
    pump.tell("slow 100")
    do = a_do(hub.server)
    running.post(do)
    until(lambda: "started" in hub.kinds and pump.moves)
    time.sleep(0.5)  # so that something has moved
    stop = StopLabFrame(stop_id=uuid4(), issued_by="ada")
    began_s = time.monotonic()
    hub.stop(stop)
    until(lambda: hub.acknowledged_stops)
    assert time.monotonic() - began_s < 1.0
    assert hub.acknowledged_stops[0].stop_id == stop.stop_id
    assert hub.acknowledged_stops[0].lines
    until(lambda: "aborted" in hub.kinds)
    body = next(one.body for one in hub.events.values() if one.kind == "aborted")
    assert 0 < body["outcome"]["moved_nl"] < 100_000
    pump.tell("slow 1")
    later = msgspec.structs.replace(a_do(hub.server), resources=[])
    running.post(later)
    until(lambda: hub.kinds.count("accepted") == 2)
    until(lambda: hub.heartbeats[-1].stop_latched)
    assert hub.kinds.count("started") == 1
    reset = Reset(
        host_id=HOST_ID,
        epoch=hub.server.epoch,
        dseq=hub.server.next_dseq(),
        stop_id=stop.stop_id,
        reason="ok",
    )
    running.post(reset)
    until(lambda: "complete" in hub.kinds)


def test_a_host_starts_its_lines_with_the_server_away_and_runs_only_once(
    running: Running, pump: PumpProcess
) -> None:
    hub = running.hub
    until(running.is_online, within_s=60)
    second = subprocess.run(
        [sys.executable, "-m", "workers.host", "--config", str(running.file)],
        cwd=ROOT,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert second.returncode == 1
    assert "runs already" in second.stderr
    running.stop()
    do = a_do(hub.server)
    running.config = msgspec.structs.replace(running.config, server_url="ws://127.0.0.1:9")
    running.post(do)
    running.start()
    until(lambda: pump.moves == ["A300"], within_s=60)


@pytest.mark.skipif(not confinement.has_proxies(), reason="this kernel has no connection proxy")
def test_a_line_whose_guard_has_ended_starts_anew_and_reaches_its_device(
    running: Running, pump: PumpProcess
) -> None:
    until(running.is_online, within_s=60)
    line, proxy = _line_and_proxy(running)
    os.kill(proxy, signal.SIGKILL)
    until(lambda: line not in _of_kinds(running, "line"), within_s=10)
    until(lambda: len(_of_kinds(running, "line")) == 2, within_s=60)
    assert proxy not in _line_and_proxy(running)
    running.post(a_do(running.hub.server))
    until(lambda: "complete" in running.hub.kinds, within_s=60)
    assert pump.moves == ["A300"]
    assert len(_of_kinds(running, "accept", "uplink", "line")) == 4, "Celery has renamed one"


def _line_and_proxy(running: Running) -> tuple[int, int]:
    one, other = _of_kinds(running, "line")
    parent = int(Path(f"/proc/{other}/stat").read_text().rpartition(") ")[2].split()[1])
    return (one, other) if parent == one else (other, one)


def _children(running: Running, *kinds: str) -> list[int]:
    """Process ids of the host's own processes of these kinds."""
    found = _of_kinds(running, *kinds)
    assert len(found) == len(kinds)
    return found


def _of_kinds(running: Running, *kinds: str) -> list[int]:
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().decode().replace("\0", " ").split()
            except OSError:
                continue
            if str(running.file) in words and any(kind in words for kind in kinds):
                found.append(int(entry.name))
    return found
