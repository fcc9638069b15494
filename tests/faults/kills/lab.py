"""One edge host as real processes that are forked, not started: a kill costs little.

Each process runs what `workers.host.process_main` runs for the supervisor: the Celery worker that
accepts, one Celery worker for each line, the uplink. Broker and server stand outside, as do the
pumps, which count for themselves what they were made to do.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import time
from contextlib import ExitStack
from dataclasses import dataclass
from importlib import import_module
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any
from uuid import UUID, uuid5

import msgspec
from celery import Celery

from drivers.transports.urls import line_key
from labweb.domain.messages.commands import Command
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.messages.events import EdgeEvent, EventsFrame
from labweb.domain.messages.frames import EdgeFrame
from tests.faults.pump import CountingPump
from tests.workers.bench import BOOT_ID, HOST_ID, SPACE, Server, a_device, until
from tests.workers.hub import Hub
from workers.base import faults
from workers.base.celery_apps import ACCEPT, make_host_app, wake
from workers.base.config import HostConfig, ValkeyConfig, command_queue, line_queue
from workers.base.host_key import create_key
from workers.base.valkey_store import ValkeyStore
from workers.host.process_main import main as run_process
from workers.host.supervisor import RING_EVERY_S
from workers.host.valkey_process import find_valkey
from workers.journal.journal import Journal, create_journal
from workers.uplink.session import record_boot

# What a worker imports only when it starts: here before the fork.
PRELOADED = (
    "celery.app.amqp",
    "celery.app.control",
    "celery.app.events",
    "celery.app.log",
    "celery.apps.worker",
    "celery.bin.celery",
    "celery.bin.worker",
    "celery.concurrency.solo",
    "celery.worker.autoscale",
    "celery.worker.components",
    "celery.worker.consumer",
    "celery.worker.strategy",
    "drivers.connectors.tricontinent_c3000",
    "drivers.transports.tcp",
    "kombu.transport.redis",
)
for _name in PRELOADED:
    import_module(_name)

PUMPS_COUNT = 2
SLOWNESS = 80.0
"""A stroke of 1 µL takes 0.04 to 0.25 s, so that kills come in its middle."""


class Ledger(Hub):
    """The server's end: keeps each event before it acknowledges it, and reads it once."""

    def __init__(self, server: Server, devices: list[DeviceConfig], public_key: str) -> None:
        super().__init__(server, devices, public_key)
        self.head = 0
        self.fresh: list[EdgeEvent] = []
        self.violations: list[str] = []

    @property
    def acked(self) -> int:
        return self.head

    def _take(self, socket: Any, frame: EdgeFrame) -> None:  # noqa: ANN401 - a connection
        if isinstance(frame, EventsFrame):
            self._keep(frame.events)
            super()._take(socket, msgspec.structs.replace(frame, events=[]))
            self.frames.clear()

    def _keep(self, events: list[EdgeEvent]) -> None:
        for event in events:
            if event.seq > self.head + 1:
                self.violations.append(f"gap: event {event.seq} after {self.head}")
            elif event.seq == self.head + 1:
                self.events[event.seq] = event
                self.head = event.seq
                self.fresh.append(event)
            elif self.events[event.seq].hash != event.hash:
                self.violations.append(f"fork: event {event.seq} came again with another hash")


@dataclass
class Bench:
    """One pump, its vessels and its line."""

    pump: CountingPump
    device: DeviceConfig
    line: str
    bottle_id: UUID
    syringe_id: UUID


class Lab:
    """Server, broker, pumps, and the processes of one host."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.stack = ExitStack()
        self.server = Server()
        self.benches = [self._bench(number) for number in range(PUMPS_COUNT)]
        key = create_key(folder / "host.key")
        self.ledger = Ledger(self.server, [one.device for one in self.benches], key.public_base64)
        self.stack.enter_context(self.ledger.open())
        self._start_broker()
        self.config = self._config()
        self.config_file = folder / "host.json"
        self.config_file.write_bytes(msgspec.json.encode(self.config))
        create_journal(self.config.journal_path, HOST_ID)
        self.journal = Journal(self.config.journal_path)
        self.journal.lengthen_log()
        record_boot(self.journal)
        broker = self.config.broker_url
        self.celery = Celery("server", broker=broker, set_as_current=False, fixups=[])
        self.host_app = make_host_app(self.config)
        self.store = ValkeyStore(self.config.valkey_url)
        self._rung_s = 0.0
        self.processes: dict[str, ForkServerProcess] = {}
        self.line_pids: set[int] = set()
        self.context = multiprocessing.get_context("forkserver")
        self.context.set_forkserver_preload(["tests.faults.kills.lab"])

    @property
    def fault_file(self) -> Path:
        return self.folder / "fault"

    def _bench(self, number: int) -> Bench:
        pump = self.stack.enter_context(CountingPump(slowness=SLOWNESS))
        device = a_device(
            pump.url, id=uuid5(SPACE, f"pump {number}"), key=f"pump_{number}", statuses={}
        )
        vessels = (uuid5(SPACE, f"{kind} {number}") for kind in ("bottle", "syringe"))
        return Bench(pump, device, line_key(pump.url), *vessels)

    def _start_broker(self) -> None:
        socket = self.folder / "v"
        command = [str(find_valkey()), "--port", "0", "--unixsocket", str(socket), "--save", ""]
        popen = subprocess.Popen(command, cwd=self.folder, stdout=subprocess.DEVNULL)
        self.stack.callback(popen.wait)
        self.stack.callback(popen.kill)
        store = ValkeyStore(f"unix://{socket}?db=0")
        until(store.ping)
        store.close()

    def _config(self) -> HostConfig:
        return HostConfig(
            host_id=HOST_ID,
            name="bench",
            server_url=self.ledger.url,
            broker_url=f"redis+socket://{self.folder / 'v'}?virtual_host=3",
            data_dir=str(self.folder / "data"),
            key_file=str(self.folder / "host.key"),
            valkey=ValkeyConfig(socket=str(self.folder / "v")),
        )

    # --- processes ---

    def names(self) -> list[str]:
        return ["accept", "uplink", *(one.line for one in self.benches)]

    def keep(self) -> list[tuple[str, int]]:
        """Start what does not run: the lines only once the server has said which there are.

        Returns:
            Which ended by themselves, and with which code.
        """
        ended = []
        wanted = self.names() if self.journal.devices() else ["uplink"]
        for name in wanted:
            process = self.processes.get(name)
            if process is not None and process.exitcode is not None:
                ended.append((name, process.exitcode))
                process = None
            if process is None:
                self.processes[name] = self._start(name)
        return ended

    def ring(self) -> None:
        """Post lost wake-ups again, as the supervisor does."""
        if time.monotonic() - self._rung_s < RING_EVERY_S:
            return
        self._rung_s = time.monotonic()
        for line in self.journal.waiting_lines():
            if self.store.queue_length(line_queue(line)) == 0:
                wake(self.host_app, line)

    def _start(self, name: str) -> ForkServerProcess:
        words = [name] if name in {"accept", "uplink"} else ["line", name]
        argv = [words[0], str(self.config_file), *words[1:]]
        arguments = (argv, str(self.fault_file), str(self.folder / "log"))
        process = self.context.Process(target=become, args=arguments, daemon=True)
        process.start()
        if words[0] == "line" and process.pid is not None:
            self.line_pids.add(process.pid)
        return process

    def kill(self, name: str) -> bool:
        """End a process as a power cut would; False: it was not running."""
        process = self.processes.get(name)
        if process is None or process.pid is None or process.exitcode is not None:
            return False
        try:
            os.kill(process.pid, signal.SIGKILL)
        except ProcessLookupError:  # it fell at a point of the code in this very moment
            return False
        del self.processes[name]
        process.join()
        return True

    # --- messages ---

    def post(self, command: Command) -> None:
        """Publish as the server's relay does."""
        signed = msgspec.to_builtins(self.server.sign(command))
        self.celery.send_task(ACCEPT, args=[signed], queue=command_queue(HOST_ID))

    def nudge(self, command: Command) -> None:
        """Tell it over the uplink, if there is one."""
        try:
            self.ledger.nudge(self.server.sign(command))
        except (OSError, AssertionError, RuntimeError):
            return
        except Exception as error:
            if type(error).__module__.startswith("websockets"):
                return
            raise

    def close(self) -> None:
        for name in list(self.processes):
            self.kill(name)
        self.store.close()
        self.journal.close()
        self.stack.close()


def become(argv: list[str], fault_file: str, log: str) -> None:
    """Be one process of the host, until it is killed."""
    handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    os.environ |= {
        "LABWEB_BOOT_ID": BOOT_ID,
        "LABWEB_FAULTS": "1",
        "LABWEB_FAULT_FILE": fault_file,
    }
    faults.arm()
    run_process(argv)
