"""Three edge hosts and a server, each in a network namespace of its own, on one switch.

Of a host everything is real: accept and line as Celery workers, uplink, journal, its own
Valkey. The server's end keeps events, and plays them back into a record of the vessels, which
has to come out as the host's own.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import subprocess
import threading
import time
from collections import Counter
from contextlib import ExitStack
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any
from uuid import UUID, uuid5

import msgspec
from celery import Celery

from drivers.transports.urls import line_key
from labweb.domain.canonical_json import canonical
from labweb.domain.messages.commands import Command, Do
from labweb.domain.messages.events import EventsFrame
from labweb.domain.messages.frames import EdgeFrame
from labweb.domain.runs.host_link.host_session import SessionState, state_by_silence
from tests.faults.kills.lab import Ledger
from tests.faults.netns import Net
from tests.faults.pump import CountingPump
from tests.workers.bench import BOOT_ID, SPACE, Server, a_bottle, a_device, a_do, a_syringe, until
from workers.base.celery_apps import ACCEPT
from workers.base.config import HostConfig, ValkeyConfig, command_queue
from workers.base.host_key import create_key
from workers.base.valkey_store import ValkeyStore
from workers.host.process_main import main as run_process
from workers.host.valkey_process import find_valkey
from workers.journal.journal import Journal, create_journal
from workers.uplink import reconnect_backoff, uplink
from workers.uplink.session import record_boot

SERVER = "server"
HOSTS = ("a", "b", "c")
BOTTLE_NL = 10**9
AGAIN_S = 1.0
STROKE_UL = 1
FIRST_SPEED, SPEEDS_COUNT = 1000, 4500
"""Each action has a speed of its own, until all were used, so that the pump tells them apart."""

STROKES_COUNT = 900
"""So many in, then as many out."""


class Ear(Ledger):
    """The server's end for one host: when it last heard, and what the events say."""

    heard_s = 0.0

    def _take(self, socket: Any, frame: EdgeFrame) -> None:  # noqa: ANN401 - a connection
        self.heard_s = time.monotonic()
        super()._take(socket, frame)
        if isinstance(frame, EventsFrame):
            return

    def state(self) -> SessionState:
        """What the server's rule makes of the silence."""
        return state_by_silence(SessionState.ONLINE, time.monotonic() - self.heard_s)


class Host:
    """One edge host with one pump, and the server's end for it."""

    def __init__(self, name: str, folder: Path, net: Net, broker_url: str) -> None:
        self.name, self.net, self.folder = name, net, folder / name
        self.folder.mkdir()
        self.id = uuid5(SPACE, f"host {name}")
        self.server = Server()
        self.stack = ExitStack()
        self.pump = self._pump()
        self.device = a_device(self.pump.url, id=uuid5(self.id, "pump"), statuses={})
        self.line = line_key(self.pump.url)
        self.bottle_id, self.syringe_id = uuid5(self.id, "bottle"), uuid5(self.id, "syringe")
        key = create_key(self.folder / "host.key")
        self.ear = Ear(self.server, [self.device], key.public_base64)
        self.stack.enter_context(self.ear.open(host=net.address(SERVER)))
        self.config = HostConfig(
            host_id=self.id,
            name=name,
            server_url=self.ear.url,
            broker_url=broker_url,
            data_dir=str(self.folder / "data"),
            key_file=str(self.folder / "host.key"),
            valkey=ValkeyConfig(socket=str(self.folder / "v")),
        )
        (self.folder / "host.json").write_bytes(msgspec.json.encode(self.config))
        create_journal(self.config.journal_path, self.id)
        self.journal = Journal(self.config.journal_path)
        self.journal.lengthen_log()
        record_boot(self.journal)
        self.celery = Celery("server", broker=broker_url, set_as_current=False, fixups=[])
        self.processes: list[ForkServerProcess] = []
        self.open: dict[UUID, tuple[Do, float]] = {}
        self.ends: list[tuple[float, str]] = []
        self.is_known = False
        self.asked: Counter[int] = Counter()
        self.record = {self.bottle_id: {"lot": BOTTLE_NL}, self.syringe_id: {}}

    def _pump(self) -> CountingPump:
        """Make the pump listen inside the host's namespace: a socket stays where it was made."""
        made: list[CountingPump] = []

        def make() -> None:
            self.net.enter(self.name)
            made.append(CountingPump(slowness=1.0))

        thread = threading.Thread(target=make)
        thread.start()
        thread.join()
        return self.stack.enter_context(made[0])

    def start(self, context: Any) -> None:  # noqa: ANN401 - a context of multiprocessing
        """Start Valkey, then uplink, accept and line."""
        command = [str(find_valkey()), "--port", "0", "--unixsocket", str(self.folder / "v")]
        popen = subprocess.Popen(
            [*command, "--save", ""], cwd=self.folder, stdout=subprocess.DEVNULL
        )
        self.stack.callback(popen.wait)
        self.stack.callback(popen.kill)
        store = ValkeyStore(self.config.valkey_url)
        until(store.ping)
        store.close()
        self._fork(context, "uplink")
        until(self.journal.devices, within_s=60)
        self._fork(context, "accept")
        self._fork(context, "line", self.line)

    def _fork(self, context: Any, kind: str, *rest: str) -> None:  # noqa: ANN401 - as above
        argv = [kind, str(self.folder / "host.json"), *rest]
        arguments = (self.net.tag, self.net.names, self.name, argv, str(self.folder / "log"))
        process = context.Process(target=become, args=arguments, daemon=True)
        process.start()
        self.processes.append(process)

    def close(self) -> None:
        for process in self.processes:
            process.kill()
            process.join()
        self.journal.close()
        self.stack.close()

    # --- work ---

    def turn(self, *, is_fed: bool = True) -> None:
        """Keep one action open, send what was not answered, read what came."""
        fresh, self.ear.fresh = self.ear.fresh, []
        for event in fresh:
            self._replay(event.body)
            if event.action_id in self.open and event.kind == "accepted":
                do, _ = self.open[event.action_id]
                self.open[event.action_id] = (do, float("inf"))
            if event.kind in {"complete", "aborted", "rejected", "in_doubt"}:
                self.open.pop(event.action_id, None)  # type: ignore[arg-type]
                code = str(event.body.get("code") or "")
                self.ends.append((time.monotonic(), f"{event.kind} {code}".strip()))
        if not self.open and is_fed:
            self._submit()
        for action_id, (do, sent_s) in list(self.open.items()):
            if time.monotonic() - sent_s > AGAIN_S and self.server.epoch:
                self.open[action_id] = (do, time.monotonic())
                self.post(msgspec.structs.replace(do, epoch=self.server.epoch))

    def _submit(self) -> None:
        number = self.asked.total()
        speed = FIRST_SPEED + number % SPEEDS_COUNT
        self.asked[speed] += 1
        views = [
            a_bottle(id=self.bottle_id, contents={"lot": BOTTLE_NL}, capacity_nl=2 * BOTTLE_NL),
            a_syringe(id=self.syringe_id, capacity_nl=BOTTLE_NL),
        ]
        is_down = (number // STROKES_COUNT) % 2 == 1
        vessels = (self.bottle_id, self.syringe_id)
        source, target = vessels[::-1] if is_down else vessels
        do = a_do(
            self.server,
            host_id=self.id,
            device_id=self.device.id,
            action="dispense" if is_down else "aspirate",
            args={"volume_ul": float(STROKE_UL), "rate_ul_s": speed / 3},
            operation={
                "op": "transfer_liquid",
                "source_id": str(source),
                "target_id": str(target),
                "amount_nl": STROKE_UL * 1000,
            },
            resources=[] if self.is_known else views,
            ttl_s=600.0,
        )
        self.is_known = True
        self.open[do.action_id] = (do, 0.0)

    def post(self, command: Command) -> None:
        signed = msgspec.to_builtins(self.server.sign(command))
        self.celery.send_task(ACCEPT, args=[signed], queue=command_queue(self.id))

    # --- what the server knows, and what is ---

    def _replay(self, body: dict[str, Any]) -> None:
        for one in body.get("change", {}).get("postings", []):
            for account, sign in ((one["debit"], -1), (one["credit"], 1)):
                lots = self.record[UUID(account)]
                lots[one["lot"]] = lots.get(one["lot"], 0) + sign * one["amount_nl"]

    def is_settled(self) -> bool:
        """Say whether the server has the whole log and nothing is open."""
        head = self.journal.head()[0]
        return not self.open and not self.ear.fresh and self.ear.head == head

    def digests(self) -> tuple[str, str]:
        """Digest the vessels as the server has them from events, and as the host has them."""
        held: dict[str, dict[str, int]] = {}
        with self.journal.write() as tx:
            for vessel_id in self.record:
                found = tx.resource(vessel_id)
                held[str(vessel_id)] = {} if found is None else dict(found.view.contents)
        told = {str(vessel_id): dict(lots) for vessel_id, lots in self.record.items()}
        return digest(told), digest(held)

    def most_actuations(self) -> int:
        """How often the pump was made to do one action, at most; each has a speed of its own."""
        done = Counter(self.pump.speeds)
        beyond = max((done[speed] - self.asked[speed] for speed in done), default=-1)
        return 1 + max(beyond, -1 if not done else 0)


def digest(contents: dict[str, dict[str, int]]) -> str:
    """Digest amounts by lot and vessel; nothing and an amount of nothing are one."""
    known = {
        vessel: {lot: amount for lot, amount in sorted(lots.items()) if amount}
        for vessel, lots in sorted(contents.items())
    }
    return hashlib.sha256(canonical(known)).hexdigest()


class Lab:
    """The server's namespace, which this process enters, and three hosts."""

    def __init__(self, folder: Path, net: Net) -> None:
        self.net, self.stack = net, ExitStack()
        net.enter(SERVER)
        os.environ["LABWEB_BOOT_ID"] = BOOT_ID
        address = net.address(SERVER)
        command = [str(find_valkey()), "--port", "6390", "--bind", address, "--save", ""]
        popen = subprocess.Popen(
            [*command, "--protected-mode", "no"], cwd=folder, stdout=subprocess.DEVNULL
        )
        self.stack.callback(popen.wait)
        self.stack.callback(popen.kill)
        store = ValkeyStore(f"redis://{address}:6390/0")
        until(store.ping)
        store.close()
        broker = f"redis://{address}:6390/3"
        self.hosts = [Host(name, folder, net, broker) for name in HOSTS]
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["tests.faults.partitions.lab"])
        for host in self.hosts:
            self.stack.callback(host.close)
            host.start(context)

    def close(self) -> None:
        self.stack.close()


def become(tag: str, names: list[str], name: str, argv: list[str], log: str) -> None:
    """Be one process of a host in its namespace; an outage of seconds stands for one of minutes."""
    handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    os.environ["LABWEB_BOOT_ID"] = BOOT_ID
    Net(tag, names).enter(name)
    uplink.SILENCE_S, uplink.ACK_TIMEOUT_S, uplink.HANDSHAKE_S = 3.0, 2.0, 3.0
    reconnect_backoff.LONGEST_RETRY_S = 1.0
    run_process(argv)
