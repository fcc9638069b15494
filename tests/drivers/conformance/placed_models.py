"""Drivers against the simulated instruments of their models, through the real transport."""

import importlib
import json
import socket
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

from drivers.base import Driver, Report
from drivers.load import call_action, load_driver, read_spec
from drivers.transports import modbus
from drivers.transports.opcua import transport as opcua
from drivers.transports.s7 import transport as s7
from drivers.transports.sila import transport as sila
from drivers.transports.urls import make_transport
from fixtures.instruments.models import MODELS
from labweb.domain.errors import DeviceError, LabError
from tests.fixtures.hand_bench import a_document, a_vessel
from tests.fixtures.running import Process, until

SPEED = 50
"""Simulated seconds in a real one."""

PATIENT_S = 5.0
"""So long a driver waits where no test looks at how long it does."""

QUICK = {
    "poll_s": 0.02,
    "settle_s": 0.05,
    "heat_limit_s": 6.0,
    "reach_limit_s": 6.0,
    "speed_limit_s": 3.0,
    "vent_limit_s": 6.0,
    "grace_s": 0.2,
    "home_limit_s": 2.0,
}
"""Settings with which a driver is as fast as the simulated instruments."""

Action = tuple[str, dict[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Case:
    """One driver, the model that it drives, and what its role is asked to do."""

    module: str
    """Below `drivers`."""

    model: str
    carrier: str = "pty"
    config: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    act: Action = ("", {})
    """What takes a while."""

    outer: dict[str, Any] = field(default_factory=dict)
    """Settings that control by a sensor outside the instrument."""

    cold_c: float = -10.0
    """A temperature below the room's that a thermostat reaches."""

    also: str = ""
    """Setting with the further port that the driver needs."""

    ports: tuple[str, ...] = ()
    """Ports that vessels hang at; the first is at its flask, the others at empty ones."""

    side: str = "also"
    """How its URL names that port."""

    address: str = ""
    """What stands in its URL behind place or port: `/0/1`, `?device=9`."""

    verb: str = ""
    """How the simulated instrument records that act."""

    beyond: tuple[Action, ...] = ()
    """What is refused before a byte is sent."""

    status: str = ""
    """A number that the instrument tells."""

    is_instant: bool = False
    """The act is over before anything can happen to it."""

    no_busy: str = ""
    """Why its protocol cannot show that it is busy; "" where it can."""

    ready: tuple[Action, ...] = ()
    """What is done before it could do anything else, such as being busy."""

    at_first: tuple[Action, ...] = ()
    """What a person has to say before it knows where it stands."""

    starts: int = 1
    """How many starts the instrument records for one such act."""

    closings: int = 0
    """How many starts more its way to the safe state is recorded as."""

    asks: int = 5
    """How many exchanges one such act takes at least; a later answer cannot be lost."""

    refuses_late: bool = False
    """When busy it accepts a command, and its result says that nothing was done."""

    ends_dark: bool = False
    """Its process does not end while a command is under way: it loses its power before."""

    is_latching: bool = False
    """A fault of the instrument stays until it is switched off and on."""

    is_unchecked: bool = False
    """Binary frames without a checksum of their own: a byte that TCP let through is not seen."""

    @property
    def dotted(self) -> str:
        return f"drivers.{self.module}"


class Bench:
    """One running process with an instrument for each case."""

    def __init__(self, process: Process, folder: Path, sides: Mapping[str, int]) -> None:
        self._process = process
        self._folder = folder
        self._sides = sides
        """Further ports, by model."""

    def url(self, case: Case) -> str:
        sort = read_spec(case.dotted).transport
        if case.carrier == "pty":
            scheme = "modbus+serial" if sort == "register" else "serial"
            return f"{scheme}://{self._folder}/{case.model}{case.address}"
        scheme = {
            "register": "modbus+tcp",
            "opcua": "opc.tcp",
            "s7": "s7",
            "sila": "sila+local",
            "http": "http",
        }.get(sort, "tcp")
        url = f"{scheme}://127.0.0.1:{self._port(case)}{case.address}"
        return f"{url}?{case.side}={self._sides[case.model]}" if case.also else url

    def driver(self, case: Case, **config: object) -> Driver[Any, Any]:
        """Load the driver as an edge host does; nothing is opened."""
        spec = read_spec(case.dotted)
        known = {one.name for one in spec.config}
        quick = {name: value for name, value in QUICK.items() if name in known}
        transport = make_transport(self.url(case))
        settings = {**quick, **case.config, **config}
        return load_driver(case.dotted, spec.class_name, spec.digest, transport, settings)

    @contextmanager
    def connected(self, case: Case, **config: object) -> Iterator[Driver[Any, Any]]:
        """Connect to a cured instrument; afterwards it is brought to its safe state."""
        self.cure(case)
        if case.is_latching:
            self.inflict(case, "power_loss", for_s=0.5)
            until(lambda: not self.faults(case))
        driver = self.driver(case, **config)
        until(lambda: _connects(driver), 20)
        for act in case.at_first:
            do(driver, act)
        try:
            yield driver
        finally:
            self.cure(case)
            until(lambda: _halts(driver, case.at_first), 20)
            driver.close()

    def inflict(self, case: Case, fault: str, **options: object) -> None:
        status, answer = self._process.call(
            "POST", f"/instruments/{case.model}/faults", {"fault": fault, **options}
        )
        assert status == 201, answer

    def cure(self, case: Case) -> None:
        assert self._process.call("DELETE", f"/instruments/{case.model}/faults")[0] == 200

    def has_struck(self, case: Case, fault: str) -> bool:
        """Tell whether a fault that waited for its moment has met it."""
        return any(one["fault"] == fault and one["tripped"] for one in self.faults(case))

    def faults(self, case: Case) -> list[dict[str, Any]]:
        """List what is inflicted and not over."""
        return list(self._process.get(f"/instruments/{case.model}/faults"))

    def state(self, case: Case) -> dict[str, Any]:
        return dict(self._process.get(f"/instruments/{case.model}")["state"])

    def acts(self, case: Case, verb: str = "") -> list[dict[str, Any]]:
        """List what the instrument physically started, in order."""
        found = self._process.get(f"/instruments/{case.model}/actuations?since=0")
        return [one for one in found if not verb or one["verb"] == verb]

    def vessel_ul(self, name: str) -> float:
        """Tell how much a vessel of the world holds."""
        return float(self._process.get("/world")["vessels"][name]["volume_nl"]) / 1000

    def is_over(self, case: Case, verb: str = "") -> bool:
        """Tell whether nothing of this sort goes on."""
        return all(one["ending"] for one in self.acts(case, verb or case.verb))

    def _port(self, case: Case) -> int:
        return self._process.port_of(case.model)


@contextmanager
def running(
    cases: list[Case], contents: list[dict[str, Any]] | None = None, *, speed: float = SPEED
) -> Iterator[Bench]:
    """Run one process with an instrument and a vessel of its own for each case."""
    with TemporaryDirectory(prefix="lw") as name:
        folder = Path(name)
        sides = {case.model: a_free_port() for case in cases if case.also}
        vessels = [
            a_vessel(f"{case.model}_flask", 10_000.0) | ({"contents": contents} if contents else {})
            for case in cases
        ]
        vessels += [a_vessel(f"{case.model}_{port}") for case in cases for port in case.ports[1:]]
        entries = [
            {
                "id": case.model,
                "model": case.model,
                "endpoint": (
                    f"pty:{folder}/{case.model}" if case.carrier == "pty" else "tcp:127.0.0.1:0"
                ),
                "settings": case.settings | ({case.also: sides[case.model]} if case.also else {}),
                "attached": _attached(case),
            }
            for case in cases
        ]
        process = Process(folder)
        (folder / "bench.json").write_text(json.dumps(a_document(*entries, vessels=vessels)))
        process.start("--speed", str(speed))
        bench = Bench(process, folder, sides)
        try:
            yield bench
        finally:
            for case in cases:
                if case.ends_dark:
                    bench.inflict(case, "power_loss", for_s=1000.0)
            process.stop()


def _attached(case: Case) -> dict[str, Any]:
    flask = {"vessel": f"{case.model}_flask"}
    if not case.ports:
        return flask if MODELS[case.model].ATTACHES == "vessel" else {}
    others = {port: {"vessel": f"{case.model}_{port}"} for port in case.ports[1:]}
    return {"ports": {case.ports[0]: flask} | others}


def a_free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return int(found.getsockname()[1])


def do(driver: Driver[Any, Any], act: Action) -> Report:
    return call_action(driver, *act)


class Doing:
    """An action that runs on a thread of its own."""

    def __init__(self, driver: Driver[Any, Any], act: Action) -> None:
        self.error: LabError | None = None
        self._driver, self._act = driver, act
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    @property
    def is_over(self) -> bool:
        return not self._thread.is_alive()

    def has_succeeded(self) -> bool:
        """Wait for the end."""
        self._thread.join(20)
        return self.is_over and self.error is None

    def failure(self) -> LabError:
        """Wait for the end, which has to be a failure."""
        self._thread.join(20)
        assert self.is_over, "the action goes on for ever"
        assert self.error is not None, "the action succeeded"
        return self.error

    def _run(self) -> None:
        try:
            do(self._driver, self._act)
        except LabError as error:
            self.error = error


def impatient(monkeypatch: Any, case: Case, answer_s: float = 0.2) -> None:  # noqa: ANN401
    """Let the driver wait for an answer no longer than a test can."""
    module = importlib.import_module(case.dotted)
    for one in (module, *_beside(module)):
        for name in {"ANSWER_S", "TARE_S"} & vars(one).keys():
            monkeypatch.setattr(one, name, answer_s)
        for name, times in {"ASK_S": 2, "END_S": 10}.items():
            if hasattr(one, name):
                monkeypatch.setattr(one, name, times * answer_s)
    monkeypatch.setattr(modbus, "OPEN_TIMEOUT_S", answer_s)
    monkeypatch.setattr(s7, "ANSWER_S", max(answer_s, 0.3))
    monkeypatch.setattr(sila, "ANSWER_S", max(answer_s, 0.5))
    monkeypatch.setattr(opcua, "ANSWER_S", max(answer_s, 0.5))


def patient(monkeypatch: Any, case: Case) -> None:  # noqa: ANN401
    """Let the driver wait for an answer of an instrument that a slow machine does not let run."""
    monkeypatch.undo()
    module = importlib.import_module(case.dotted)
    for one in (module, *_beside(module)):
        if hasattr(one, "ANSWER_S"):
            monkeypatch.setattr(one, "ANSWER_S", max(one.ANSWER_S, PATIENT_S))


def _beside(module: ModuleType) -> list[ModuleType]:
    """List what a driver shares with its siblings: modules of its folder that are named `_…`."""
    found = (sys.modules.get(getattr(one, "__module__", "")) for one in vars(module).values())
    shared = f"{module.__package__}._"
    return list(
        {one.__name__: one for one in found if one and one.__name__.startswith(shared)}.values()
    )


def sent_by(driver: Driver[Any, Any]) -> list[bytes]:
    """Collect every byte that goes out from here on."""
    sent: list[bytes] = []
    driver.transport.observer = lambda way, data: sent.append(data) if way == "out" else None
    return sent


def _connects(driver: Driver[Any, Any]) -> bool:
    try:
        driver.connect()
    except DeviceError:
        return False
    return True


def _halts(driver: Driver[Any, Any], at_first: tuple[Action, ...]) -> bool:
    try:
        driver.connect()
        for act in at_first:
            do(driver, act)
        driver.halt()
    except DeviceError:
        return False
    return True
