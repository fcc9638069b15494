"""Builders for an edge host in a test: keys, a pump, a bottle and a syringe, signed commands."""

from __future__ import annotations

import base64
import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, cast
from uuid import UUID, uuid4, uuid5

import msgspec
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from drivers.load import read_spec
from drivers.transports.urls import line_key
from labweb.domain.crutd.operations import TransferLiquid, to_json
from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.messages.commands import Command, Do, ResourceView
from labweb.domain.messages.device_looks import LookOrder
from labweb.domain.messages.devices_and_drivers import DeviceConfig, DriverApproval, Signed
from labweb.domain.messages.driver_tryouts import TryoutOrder
from labweb.domain.messages.events import EdgeEvent, event_hash
from labweb.domain.messages.session import Welcome
from workers.base.system_clock import HostClock
from workers.base.valkey_store import ValkeyStore
from workers.journal.command_acceptance import Receipt, accept
from workers.journal.journal import Journal, create_journal
from workers.line.action_files import ActionFiles
from workers.line.device_unit import DeviceUnit
from workers.line.driver_store import DriverLoader, DriverStore
from workers.line.executor import Executor
from workers.line.line_process import make_units
from workers.uplink.session import arm, open_session

MODULE = "drivers.connectors.tricontinent_c3000"
SPACE = UUID("7a3d7f0e-6d54-4f0e-9a43-3e6a1f9a1c11")
HOST_ID = uuid5(SPACE, "host")
DEVICE_ID = uuid5(SPACE, "pump")
BOTTLE_ID, SYRINGE_ID = uuid5(SPACE, "bottle"), uuid5(SPACE, "syringe")
BOOT_ID = "boot-of-this-test"
ROOT = Path(__file__).parents[2]


class Server:
    """Signs as the server does."""

    def __init__(self) -> None:
        self._key = Ed25519PrivateKey.generate()
        self.epoch = 1
        self.dseq = 0

    @property
    def keys(self) -> dict[str, str]:
        raw = self._key.public_key().public_bytes(
            serialization.Encoding.Raw, serialization.PublicFormat.Raw
        )
        return {"k1": base64.b64encode(raw).decode()}

    def sign(self, command: Command | DriverApproval | LookOrder | TryoutOrder) -> Signed:
        body = msgspec.json.encode(command).decode()
        signature = base64.b64encode(self._key.sign(body.encode())).decode()
        return Signed(body=body, key_id="k1", signature=signature)

    def next_dseq(self) -> int:
        self.dseq += 1
        return self.dseq

    def welcome(self, *devices: DeviceConfig, **changes: Any) -> Welcome:  # noqa: ANN401 - any field
        known = Welcome(
            epoch=self.epoch,
            acked_seq=0,
            floor=0,
            server_at_s=0.0,
            mode="normal",
            devices=list(devices),
            command_keys=self.keys,
        )
        return msgspec.structs.replace(known, **changes)


class PumpProcess:
    """The counting pump, in a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.log = folder / "pump.log"
        self.popen = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("pump_server.py")), str(self.log)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.popen.stdout is not None
        self.url = f"tcp://127.0.0.1:{int(self.popen.stdout.readline())}"

    def tell(self, command: str) -> None:
        assert self.popen.stdin is not None
        assert self.popen.stdout is not None
        self.popen.stdin.write(command + "\n")
        self.popen.stdin.flush()
        assert self.popen.stdout.readline() == "ok\n"

    @property
    def moves(self) -> list[str]:
        return self.log.read_text().split() if self.log.exists() else []

    def end(self) -> None:
        self.popen.kill()
        self.popen.communicate()


def installed() -> DriverLoader:
    """Loads what the package has, and nothing else."""
    return DriverLoader(DriverStore(Path("/nowhere")), {})


@cache
def driver_digest() -> str:
    """The digest of the driver's source, read once."""
    return read_spec(MODULE).digest


def a_device(url: str, **changes: Any) -> DeviceConfig:  # noqa: ANN401 - any field
    known = DeviceConfig(
        id=DEVICE_ID,
        key="pump",
        name="Pump",
        module=MODULE,
        class_name="TricontinentC3000",
        digest=driver_digest(),
        transport=url,
        config={"syringe_ul": 1000.0},
        statuses={"volume_ul": 0.1, "port_index": 0.1},
        nodes={},
    )
    return msgspec.structs.replace(known, **changes)


def a_bottle(**changes: Any) -> ResourceView:  # noqa: ANN401 - any field
    known = ResourceView(
        id=BOTTLE_ID,
        name="bottle",
        kind="bottle",
        rev=1,
        contents={"lot": 5_000_000},
        capacity_nl=10_000_000,
    )
    return msgspec.structs.replace(known, **changes)


def a_syringe(**changes: Any) -> ResourceView:  # noqa: ANN401 - any field
    known = ResourceView(
        id=SYRINGE_ID, name="syringe", kind="syringe", rev=1, capacity_nl=1_000_000
    )
    return msgspec.structs.replace(known, **changes)


def a_do(server: Server, **changes: Any) -> Do:  # noqa: ANN401 - any field
    """Aspirate 100 µL from the bottle into the syringe."""
    operation = TransferLiquid(source_id=BOTTLE_ID, target_id=SYRINGE_ID, amount_nl=100_000)
    known = Do(
        host_id=HOST_ID,
        epoch=server.epoch,
        dseq=server.next_dseq(),
        action_id=uuid4(),
        job_id=uuid4(),
        run_id=uuid4(),
        attempt=1,
        line="",
        device_id=DEVICE_ID,
        driver_digest=driver_digest(),
        action="aspirate",
        args={"volume_ul": 100.0, "rate_ul_s": 1000.0},
        operation=to_json(operation),
        resources=[a_bottle(), a_syringe()],
        timeout_s=20.0,
    )
    return msgspec.structs.replace(known, **changes)


def by_position(device_id: UUID = DEVICE_ID, change_ul: float = 100.0) -> dict[str, Any]:
    """A post-condition: the plunger stands so much further than before."""
    condition = Condition(
        name="pump.volume",
        device_id=device_id,
        status="volume_ul",
        change=change_ul,
        tolerance=1.0,
        timeout_s=0.3,
    )
    return plain(condition)


@dataclass
class Host:
    """A journal with an armed session, and what to do with it in the test's own process."""

    folder: Path
    url: str
    server: Server = field(default_factory=Server)

    def __post_init__(self) -> None:
        self.path = self.folder / "journal.sqlite3"
        create_journal(self.path, HOST_ID)
        self.journal = Journal(self.path)
        self.device = a_device(self.url)
        open_session(self.journal, self.server.welcome(self.device))
        assert arm(self.journal)
        self.line = line_key(self.url)
        self.woken: list[str] = []
        self.units: dict[UUID, DeviceUnit] = {}
        """Those of the executor."""

    def take(self, command: Command) -> Receipt:
        return accept(self.journal, self.server.sign(command), self.woken.append)

    @contextlib.contextmanager
    def executor(self, store: ValkeyStore | None = None) -> Iterator[Executor]:
        """An executor whose devices are connected, after recovery."""
        clock = HostClock()
        units = make_units([self.device], clock, installed())
        made = Executor(
            self.journal,
            self.line,
            units,
            store=store,
            clock=clock,
            files=ActionFiles(self.folder / "files" / "line"),
        )
        self.units = units
        made.recover()
        for unit in units.values():
            unit.connect_if_due()
        try:
            yield made
        finally:
            for unit in units.values():
                unit.close()

    def events(self) -> list[EdgeEvent]:
        """All events, after checking that they are gap-free and chained."""
        found = self.journal.events_after(0)
        head = ""
        for number, event in enumerate(found, start=1):
            assert event.seq == number
            assert event.prev_hash == head
            assert event.hash == event_hash(self.journal.journal_id, head, event)
            head = event.hash
        return found

    def kinds(self, action_id: UUID | None = None) -> list[str]:
        return [one.kind for one in self.events() if action_id in {None, one.action_id}]

    def last(self, action_id: UUID) -> dict[str, Any]:
        return [one.body for one in self.events() if one.action_id == action_id][-1]

    def state(self, action_id: UUID) -> str:
        row = self.journal.action(action_id)
        assert row is not None
        return row.st.value

    def contents(self, resource_id: UUID) -> int:
        with self.journal.write() as tx:
            held = tx.resource(resource_id)
        assert held is not None
        return sum(held.view.contents.values())

    def quarantine(self, resource_id: UUID) -> str | None:
        with self.journal.write() as tx:
            held = tx.resource(resource_id)
        assert held is not None
        return held.quarantined_by


def until(condition: Callable[[], object], *, within_s: float = 10.0) -> None:
    """Wait for something that other processes do."""
    deadline_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline_s, "it did not come to pass in time"
        time.sleep(0.02)


def environment(**changes: str) -> dict[str, str]:
    return {**os.environ, "LABWEB_BOOT_ID": BOOT_ID, **changes}


def plain(value: Any) -> dict[str, Any]:  # noqa: ANN401 - any struct
    return cast("dict[str, Any]", msgspec.to_builtins(value))
