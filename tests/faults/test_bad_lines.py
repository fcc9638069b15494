"""A bad network between host and server, and between host and instrument."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.faults.lines import Line, a_line_to
from tests.faults.pump import CountingPump
from tests.workers.bench import BOOT_ID, HOST_ID, SYRINGE_ID, Host, a_do, until
from tests.workers.hub import Hub
from workers.base import faults
from workers.base.config import HostConfig, ValkeyConfig
from workers.base.host_key import HostKey, create_key, load_key
from workers.base.valkey_store import ValkeyStore
from workers.enrollment.host_identity import HostIdentity
from workers.journal.journal import Journal
from workers.uplink import reconnect_backoff, uplink

pytestmark = pytest.mark.timeout(120)

EVENTS_COUNT = 40


@pytest.fixture(autouse=True)
def _one_boot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LABWEB_BOOT_ID", BOOT_ID)


# --- between host and instrument ---


@pytest.mark.parametrize(
    ("toxic", "final", "count"),
    [
        ({"kind": "latency", "delay_s": 0.05, "jitter_s": 0.04}, "complete", 1),
        ({"kind": "slicer", "size_bytes": 2, "spread_bytes": 1, "delay_s": 0.005}, "complete", 1),
        ({"kind": "bandwidth", "bytes_per_s": 500}, "complete", 1),
        ({"kind": "half_open", "way": "down"}, "aborted", 0),  # it did not answer to a question
        ({"kind": "half_open", "way": "up"}, "aborted", 0),
        ({"kind": "reset", "after_bytes": 0}, "aborted", 0),
        ({"kind": "down"}, "aborted", 0),
    ],
    ids=lambda value: f"{value['kind']} {value.get('way', '')}" if isinstance(value, dict) else "",
)
def test_an_instrument_behind_a_bad_line_acts_at_most_once(
    tmp_path: Path, toxic: dict[str, Any], final: str, count: int
) -> None:
    with CountingPump() as pump, a_line_to(pump.url, seed=5) as line:
        host = Host(tmp_path / "host", line.through(pump.url))
        do = a_do(host.server)
        host.take(do)
        with host.executor() as executor:
            line.add(**toxic)
            executor.drain()
        assert host.state(do.action_id) == final
        assert len(pump.moves) == count
        assert host.contents(SYRINGE_ID) == 100_000 * count
        host.journal.close()


@pytest.mark.parametrize(
    ("extra_bytes", "count"), [(0, 0), (6, 0), (13, 1)], ids=["before", "within", "behind"]
)
def test_a_line_that_breaks_around_the_command_leaves_it_in_doubt(
    tmp_path: Path, extra_bytes: int, count: int
) -> None:
    """Before, within and right behind the bytes that make the pump act."""
    with CountingPump() as pump, a_line_to(pump.url) as line:
        host = Host(tmp_path / "host", line.through(pump.url))
        do, later = a_do(host.server), a_do(host.server, resources=[])
        host.take(do)
        host.take(later)
        with host.executor() as executor:
            passed = line.state()["passed_bytes"]["up"]
            asked = len(b"/1?6\r") + len(b"/1?\r")
            line.add("reset", after_bytes=passed + asked + extra_bytes, way="up")
            executor.drain()
            line.mend()
            assert host.state(do.action_id) == "in_doubt"
            assert executor.drain() == 0
        assert host.state(later.action_id) == "accepted"
        assert len(pump.moves) == count
        host.journal.close()


# --- between host and server ---


class Bench:
    """A host's uplink in this process, and the server behind a bad line."""

    def __init__(self, folder: Path, hub: Hub, line: Line, host: Host, key: HostKey) -> None:
        self.folder, self.hub, self.line, self.host, self.key = folder, hub, line, host, key
        self.config = HostConfig(
            host_id=HOST_ID,
            name="bench",
            server_url=line.through(hub.url),
            broker_url="memory://",
            data_dir=str(host.folder),
            key_file=str(folder / "host.key"),
            valkey=ValkeyConfig(socket="/nowhere"),
        )

    def is_whole(self) -> bool:
        """Say whether the server has the whole log, and the host knows it."""
        head = self.host.journal.head()[0]
        return self.hub.acked == head == self.host.journal.acked_seq()

    def check(self) -> None:
        """The server's log is the host's: each event once, in order, chained."""
        heard = [self.hub.events[seq] for seq in sorted(self.hub.events)]
        bare = [msgspec.structs.replace(one, happened_s=None, uncertainty_s=None) for one in heard]
        assert bare == self.host.events()


@contextmanager
def a_bench(folder: Path) -> Iterator[Bench]:
    host = Host(folder / "host", "tcp://127.0.0.1:9")
    key = create_key(folder / "host.key")
    hub = Hub(host.server, [host.device], key.public_base64)
    with hub.open(), a_line_to(hub.url, seed=11) as line:
        yield Bench(folder, hub, line, host, key)
    host.journal.close()


TOXICS: list[dict[str, Any]] = [
    {"kind": "latency", "delay_s": 0.1, "jitter_s": 0.08},
    {"kind": "slicer", "size_bytes": 20, "spread_bytes": 15, "delay_s": 0.001, "way": "down"},
    {"kind": "bandwidth", "bytes_per_s": 30_000},
    {"kind": "reset", "after_bytes": 3000, "way": "up"},
    {"kind": "reset", "after_bytes": 250, "way": "down"},
    {"kind": "half_open", "way": "down"},
    {"kind": "half_open", "way": "up"},
    {"kind": "half_open"},
    {"kind": "down"},
]


@pytest.mark.parametrize("toxic", TOXICS, ids=lambda toxic: f"{toxic['kind']} {toxic.get('way')}")
async def test_the_server_gets_every_event_once_over_a_bad_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, toxic: dict[str, Any]
) -> None:
    for name, value in (("ACK_TIMEOUT_S", 0.7), ("HANDSHAKE_S", 1.5)):
        monkeypatch.setattr(uplink, name, value)
    monkeypatch.setattr(reconnect_backoff, "LONGEST_RETRY_S", 0.6)
    with a_bench(tmp_path) as bench:
        store = ValkeyStore("unix:///nowhere")
        made = uplink.Uplink(
            bench.config,
            bench.host.journal,
            HostIdentity(bench.key, Path("-"), None, None),
            store,
            lambda _: None,
        )
        task = asyncio.create_task(made.run())
        await _until(bench.is_whole)
        for number in range(EVENTS_COUNT):
            if number == EVENTS_COUNT // 3:
                await asyncio.to_thread(lambda: bench.line.add(**toxic))
            bench.host.take(a_do(bench.host.server, resources=[]))
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.7)
        await asyncio.to_thread(bench.line.mend)
        await _until(bench.is_whole)
        bench.check()
        assert len(bench.hub.events) >= EVENTS_COUNT
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def _until(condition: Any, within_s: float = 20.0) -> None:  # noqa: ANN401 - any callable
    async with asyncio.timeout(within_s):
        while not condition():
            await asyncio.sleep(0.02)


# --- each place of the uplink with each fault ---

PLACES = [place for place in faults.POINTS if place.startswith("uplink.")]
KINDS = ("kill", "raise", "disk_full", "fsync", "timeout", "partial")


@contextmanager
def a_saboteur(line: Line) -> Iterator[tuple[str, threading.Event]]:
    """Give an address where a fault makes the line silent (mute), or breaks it (stall).

    With it comes what is set once that was done.
    """
    server, is_done = socket.create_server(("127.0.0.1", 0)), threading.Event()

    def serve() -> None:
        while True:
            try:
                client, _ = server.accept()
            except OSError:
                return
            with client:
                word = client.recv(16).strip()
                line.add("half_open") if word == b"mute" else line.add("reset", after_bytes=40)
                is_done.set()
                client.sendall(b"ok\n")

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield f"127.0.0.1:{server.getsockname()[1]}", is_done
    finally:
        server.shutdown(socket.SHUT_RDWR)
        server.close()
        thread.join(5)


def connect(config: HostConfig, variables: dict[str, str]) -> None:
    """Be the uplink process, with short patience."""
    os.environ.update(variables)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    if faults.are_wanted():
        faults.arm()
    uplink.ACK_TIMEOUT_S = uplink.HANDSHAKE_S = 0.6
    reconnect_backoff.LONGEST_RETRY_S = 0.5
    journal = Journal(config.journal_path)
    key = load_key(Path(config.key_file))
    made = uplink.Uplink(
        config,
        journal,
        HostIdentity(key, Path("-"), None, None),
        ValkeyStore("unix:///nowhere"),
        lambda _: None,
    )
    asyncio.run(made.run())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("place", PLACES)
def test_a_fault_of_the_uplink_loses_nothing_and_repeats_nothing(
    tmp_path: Path, place: str, kind: str
) -> None:
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.faults.test_bad_lines"])
    with a_bench(tmp_path) as bench, a_saboteur(bench.line) as (saboteur, is_done):
        for _ in range(3):
            bench.host.take(a_do(bench.host.server, resources=[]))
        variables = {
            "LABWEB_BOOT_ID": BOOT_ID,
            "LABWEB_FAULTS": "1",
            "LABWEB_FAULT": f"{place}:{kind}",
            "LABWEB_FAULT_DEVICE": saboteur,
        }
        first = context.Process(target=connect, args=(bench.config, variables))
        first.start()
        if kind in {"kill", "raise"}:
            first.join(15)
            assert first.exitcode == (-signal.SIGKILL if kind == "kill" else 1)
        elif kind in {"timeout", "partial"}:
            assert is_done.wait(15)
        else:
            time.sleep(0.7)
        bench.line.mend()
        acked = bench.host.journal.acked_seq()
        assert acked <= bench.hub.acked
        if first.is_alive() and kind in {"disk_full", "fsync"}:
            first.kill()  # its disk stays broken for life
            first.join(15)
        first.join(0.1)
        second = context.Process(target=connect, args=(bench.config, {"LABWEB_BOOT_ID": BOOT_ID}))
        if not first.is_alive():
            second.start()
        until(bench.is_whole, within_s=20)
        bench.check()
        assert bench.host.journal.acked_seq() >= acked
        for process in (first, second):
            if process.pid is not None:
                process.kill()
                process.join()
