"""Edge hosts as they really run, for measuring: supervisor, workers, journal, uplink.

The server's end is the smallest there is (`tests.workers.hub`), so that what is measured is
the host. The devices are the host's own timers, which wait for nothing.
"""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from uuid import UUID, uuid4, uuid5

import msgspec
from celery import Celery

from drivers.load import read_spec
from labweb.domain.messages.commands import Cancel, Do, ResourceView
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.messages.events import EdgeEvent
from tests.faults.kills.lab import Ledger
from tests.workers.bench import ROOT, SPACE, Server
from workers.base.celery_apps import ACCEPT, post
from workers.base.config import HostConfig, ValkeyConfig, command_queue
from workers.base.host_key import create_key
from workers.base.valkey_store import ValkeyStore
from workers.host.valkey_process import find_valkey

MODULE = "drivers.virtual.timer"
START_S = 120.0
FINAL = frozenset({"complete", "aborted", "rejected", "stopped", "in_doubt"})


class Watched(Ledger):
    """A server's end that says at once when something came."""

    def __init__(self, server: Server, devices: list[DeviceConfig], public_key: str) -> None:
        super().__init__(server, devices, public_key)
        self.came = threading.Condition()
        self.counts: Counter[str] = Counter()
        self.on_end: Callable[[EdgeEvent], None] | None = None
        """Is told of each end on the thread that heard it, before that is acknowledged."""

    def _keep(self, events: list[EdgeEvent]) -> None:
        with self.came:
            known = self.head
            super()._keep(events)
            new = [event for event in events if event.seq > known]
            self.counts.update(event.kind for event in new)
            self.came.notify_all()
        for event in new:
            if self.on_end is not None and event.kind in FINAL:
                self.on_end(event)


class Host:
    """One edge host with some timers, each on a line of its own."""

    def __init__(self, folder: Path, name: str, broker_url: str, devices_count: int) -> None:
        self.id = uuid5(SPACE, f"host {name}")
        self.name = name
        self.folder = folder / name
        self.folder.mkdir()
        self.server = Server()
        self.devices = [self._device(number) for number in range(devices_count)]
        key = create_key(self.folder / "host.key")
        self.hub = Watched(self.server, self.devices, key.public_base64)
        self.broker_url = broker_url
        self.celery = Celery("server", broker=broker_url, set_as_current=False, fixups=[])
        self._known: set[UUID] = set()
        self.ends: dict[UUID, str] = {}
        self.pid = 0

    def _device(self, number: int) -> DeviceConfig:
        return DeviceConfig(
            id=uuid5(self.id, f"timer {number}"),
            key=f"timer_{number}",
            name=f"Timer {number}",
            module=MODULE,
            class_name="HostTimer",
            digest=read_spec(MODULE).digest,
            transport=f"virtual:{self.name}-{number}",
            config={},
            statuses={},
            nodes={},
        )

    @contextmanager
    def running(self) -> Iterator[None]:
        """Start the host's supervisor and wait for its session."""
        with ExitStack() as stack:
            stack.enter_context(self.hub.open())
            config = HostConfig(
                host_id=self.id,
                name=self.name,
                server_url=self.hub.url,
                broker_url=self.broker_url,
                data_dir=str(self.folder / "data"),
                key_file=str(self.folder / "host.key"),
                valkey=ValkeyConfig(socket=str(self.folder / "v")),
                log_level="WARNING",
            )
            path = self.folder / "host.json"
            path.write_bytes(msgspec.json.encode(config))
            with (self.folder / "log").open("wb") as log:
                popen = subprocess.Popen(
                    [sys.executable, "-m", "workers.host", "--config", str(path)],
                    cwd=ROOT,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                )
            self.pid = popen.pid
            stack.callback(popen.wait)
            stack.callback(popen.terminate)
            wait_for(lambda: self.hub.hellos and self.server.epoch, START_S)
            # What reaches the host before it has opened the session is void, and comes only once.
            wait_for(lambda: self._epoch(config) == self.server.epoch, START_S)
            yield

    def _epoch(self, config: HostConfig) -> int:
        """Return the session that the host's journal knows of."""
        with closing(sqlite3.connect(f"file:{config.journal_path}?mode=ro", uri=True)) as journal:
            found = journal.execute("SELECT value FROM meta WHERE key = 'epoch'").fetchone()
        return 0 if found is None else int(found[0])

    def a_step(self, device: DeviceConfig, duration_s: float = 0.0) -> Do:
        """Make a step that waits for so long on that timer."""
        view = ResourceView(id=device.id, name=device.name, kind="timer", rev=1)
        is_known = device.id in self._known
        self._known.add(device.id)
        return Do(
            host_id=self.id,
            epoch=self.server.epoch,
            dseq=self.server.next_dseq(),
            action_id=uuid4(),
            job_id=uuid4(),
            run_id=uuid4(),
            attempt=1,
            line="",
            device_id=device.id,
            driver_digest=device.digest,
            action="wait",
            args={"duration_s": duration_s},
            operation={"op": "read", "device_id": str(device.id), "statuses": []},
            resources=[] if is_known else [view],
            timeout_s=60.0 + duration_s,
            ttl_s=3600.0,
        )

    def cancel(self, step: Do) -> None:
        """Ask for the end of a step, whether or not it has begun."""
        wanted = Cancel(
            host_id=self.id,
            epoch=self.server.epoch,
            dseq=self.server.next_dseq(),
            action_id=step.action_id,
        )
        self.post(wanted)

    def post(self, command: Do | Cancel) -> None:
        """Publish as the server's relay does."""
        signed = msgspec.to_builtins(self.server.sign(command))
        post(self.celery, ACCEPT, [signed], command_queue(self.id))

    def events(self, kind: str) -> list[EdgeEvent]:
        """Return the events of a kind that the server has, in order."""
        return [event for _, event in sorted(self.hub.events.items()) if event.kind == kind]

    def wait_for_end(self, action_id: UUID, within_s: float = 60.0) -> str:
        """Wait until the server has heard how an action ended."""
        deadline_s = time.monotonic() + within_s
        with self.hub.came:
            while True:
                fresh, self.hub.fresh = self.hub.fresh, []
                for event in fresh:
                    if event.kind in FINAL and event.action_id is not None:
                        self.ends[event.action_id] = event.kind
                if action_id in self.ends:
                    return self.ends[action_id]
                if not self.hub.came.wait(max(0.0, deadline_s - time.monotonic())):
                    raise TimeoutError(f"{action_id} has not ended after {within_s:g} s")


def wait_for(condition: Callable[[], object], within_s: float) -> None:
    """Wait for something that other processes do."""
    deadline_s = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"it did not come to pass within {within_s:g} s")
        time.sleep(0.005)


@contextmanager
def a_broker(parent: Path) -> Iterator[tuple[Path, str]]:
    """Start a Valkey as the server's broker; yield a short folder for hosts, and its address."""
    os.environ.pop("LABWEB_FAULTS", None)
    with tempfile.TemporaryDirectory(prefix="bn", dir=parent) as name:
        folder = Path(name)
        socket = folder / "broker"
        command = [str(find_valkey()), "--port", "0", "--unixsocket", str(socket), "--save", ""]
        popen = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)
        try:
            store = ValkeyStore(f"unix://{socket}?db=0")
            wait_for(store.ping, START_S)
            store.close()
            yield folder, f"redis+socket://{socket}?virtual_host=3"
        finally:
            popen.terminate()
            popen.wait()
