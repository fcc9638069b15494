"""Simulated instruments on their wires, and the drivers that speak to them."""

from __future__ import annotations

import importlib
import json
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from drivers.base import Driver
from drivers.load import call_action
from drivers.transports.base import ByteTransport, Direction
from drivers.transports.urls import make_transport
from labweb.domain.errors import DeviceTimeoutError
from tests.drivers.conformance import placed_models
from tests.drivers.conformance.instruments import CASES, Case
from tests.fixtures.running import Process

TIMES = {"ANSWER_S": 0.3, "VALVE_S": 0.6, "INITIALIZE_S": 3.0, "SLACK_S": 0.3, "POLL_S": 0.01}
"""Instruments here are quick, so that what never comes is not waited for as long."""


class Rig:
    """One driver on its wire, with what the world behind it knows."""

    def __init__(self, case: Case, process: Process, url: str) -> None:
        self.case = case
        self.process = process
        transport = make_transport(url)
        assert isinstance(transport, ByteTransport)
        self.transport = transport
        self.transport.observer = self._observe
        self.driver: Driver[Any, Any] = case.driver_class()(transport, case.config)
        self.sent: list[bytes] = []
        self.when_acting: Callable[[], None] | None = None

    def _observe(self, direction: Direction, data: bytes) -> None:
        if direction != "out":
            return
        self.sent.append(data)
        if self.when_acting is not None and self.case.is_acting(data):
            act, self.when_acting = self.when_acting, None
            act()

    def call(self, name: str, **arguments: object) -> Any:  # noqa: ANN401 - a report
        return call_action(self.driver, name, arguments)

    def inflict(self, fault: str, **options: object) -> None:
        path = f"/instruments/{self.case.id}/faults"
        status, answer = self.process.call("POST", path, {"fault": fault, **options})
        assert status < 300, answer

    def has_struck(self, fault: str) -> bool:
        """Tell whether a fault that waited for its moment has met it."""
        found = self.process.get(f"/instruments/{self.case.id}/faults")
        return any(one["fault"] == fault and one["tripped"] for one in found)

    def switch_off_and_on(self) -> None:
        """Take all faults away, let the instrument start anew, and connect to it."""
        self.process.call("DELETE", f"/instruments/{self.case.id}/faults")
        self.inflict("power_loss", for_s=0.02)
        for _ in range(5):
            time.sleep(0.03)
            with suppress(DeviceTimeoutError):
                self.driver.connect()
                return
        self.driver.connect()

    def starts(self) -> list[str]:
        found = self.process.get(f"/instruments/{self.case.id}/actuations?since=0")
        return [one["verb"] for one in found]

    def vessel_ul(self, index: int) -> float:
        world = self.process.get("/world")
        vessel = world["vessels"][f"{self.case.id}_{index}"]
        return float(vessel["volume_nl"]) / 1000


def _start(process: Process, cases: list[Case], speed: str) -> dict[str, str]:
    folder = process.folder
    endpoints = {
        case.id: f"pty:{folder / str(n)}" if case.carrier == "pty" else "tcp:127.0.0.1:0"
        for n, case in enumerate(cases)
    }
    document = {
        "schema": "labweb.bench/1",
        "vessels": [vessel for case in cases for vessel in case.vessels()],
        "instruments": [case.instrument(endpoints[case.id]) for case in cases],
    }
    (folder / "bench.json").write_text(json.dumps(document), encoding="utf-8")
    process.start("--speed", speed)
    urls = {}
    for endpoint in process.ready["endpoints"]:
        sort, _, place = endpoint["address"].partition(":")
        urls[endpoint["instruments"][0]] = (
            f"serial://{place}" if sort == "pty" else f"tcp://{place}"
        )
    return urls


@pytest.fixture(scope="session")
def benches() -> Iterator[dict[str, tuple[Process, str]]]:
    """Start the quick instruments and those that need real time: one process each."""
    found: dict[str, tuple[Process, str]] = {}
    processes = []
    try:
        for is_slow, speed in ((False, "30"), (True, "1")):
            process = Process(Path(tempfile.mkdtemp(prefix="lw", dir="/tmp")))
            processes.append(process)
            cases = [case for case in CASES if case.is_slow is is_slow]
            urls = _start(process, cases, speed)
            found.update({case.id: (process, urls[case.id]) for case in cases})
        yield found
    finally:
        for process in processes:
            process.stop()
            shutil.rmtree(process.folder, ignore_errors=True)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    shared = ("_motion", "_dt", "_runze", "_vici", "_knauer_valve", "_chemputer", "_flow")
    for name in (*shared, *(case.module for case in CASES)):
        module = importlib.import_module(f"drivers.connectors.{name}")
        for constant, value in TIMES.items():
            if hasattr(module, constant):
                monkeypatch.setattr(module, constant, value)


@pytest.fixture(autouse=True)
def unhurried(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the driver of a placed model wait, until a test says that it shall not."""
    spec = getattr(request.node, "callspec", None)
    if spec and isinstance(case := spec.params.get("case"), placed_models.Case):
        placed_models.patient(monkeypatch, case)


@pytest.fixture
def rig(request: pytest.FixtureRequest, benches: dict[str, tuple[Process, str]]) -> Iterator[Rig]:
    """Connect the driver of the test's case; a pump has found its zero."""
    case: Case = request.param
    process, url = benches[case.id]
    rig = Rig(case, process, url)
    try:
        rig.switch_off_and_on()
        if case.role == "pump":
            rig.call("initialize")
        if case.last_port:
            rig.call("select_port", port_index=1)
        if case.role == "continuous_pump":
            rig.call("stop_flow")
        if case.role == "injection_valve":
            rig.call("select_position", position="load")
        rig.sent.clear()
        yield rig
        rig.when_acting = None
    finally:
        rig.driver.close()
        rig.transport.close()
