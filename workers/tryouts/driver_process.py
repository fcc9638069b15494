"""The process in which a driver is tried, confined before anything of the driver runs in it.

It reaches the line of its simulated instrument and nothing else: no journal, no Valkey, no local
socket, no other process. Its source comes over its input, one JSON line for each wish goes in,
one for each answer comes out. What the driver itself prints is thrown away.
"""

from __future__ import annotations

import os
import resource
import sys
import threading
from typing import IO, Any

import msgspec

from drivers.base import Driver
from drivers.load import call_action, load_bundle, read_status
from drivers.transports.urls import make_transport
from labweb.domain.errors import DeviceError, Effect, LabError
from workers.sandbox.address_bounds import bounds_of_address
from workers.sandbox.confinement import confine

MOST_MEMORY_BYTES = 2 * 1024**3
MOST_FILES = 64
MOST_PROCESSOR_S = 600


class DriverStart(msgspec.Struct, frozen=True):
    """The first line in: what is tried, and where."""

    modules: dict[str, str]
    class_name: str
    url: str
    config: dict[str, Any]
    pace: float = 1.0
    """Seconds of lab time in a real one, as its simulator runs."""


class DriverCall(msgspec.Struct, frozen=True):
    """A line in."""

    number: int
    sort: str
    name: str = ""
    args: dict[str, Any] = {}


class DriverReply(msgspec.Struct, frozen=True):
    """A line out; number 0: whether the driver could be built."""

    number: int
    code: str = ""
    message: str = ""
    effect: str = ""
    data: dict[str, Any] = {}


def main() -> None:
    """Serve one driver until the input ends."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    start = msgspec.json.decode(sys.stdin.buffer.readline(), type=DriverStart)
    limit(start.url)
    mouth = AnswerStream(output)
    try:
        transport = make_transport(start.url)
        driver = load_bundle(start.modules, start.class_name, transport, start.config)
        driver.pace = start.pace
    except LabError as error:
        mouth.refuse(0, error)
        return
    mouth.say(DriverReply(0))
    served = TriedDriver(driver, mouth)
    for line in sys.stdin.buffer:
        served.take(msgspec.json.decode(line, type=DriverCall))


def limit(url: str) -> None:
    """Bound this process to one line, to memory, files and time of the processor.

    Raises:
        StateError: The kernel refuses; nothing of the driver may run.
    """
    bounds = bounds_of_address(url)
    for sort, most in (
        (resource.RLIMIT_AS, MOST_MEMORY_BYTES),
        (resource.RLIMIT_NOFILE, MOST_FILES),
        (resource.RLIMIT_CPU, MOST_PROCESSOR_S),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(sort, (most, most))
    confine(bounds)


class AnswerStream:
    """Says one answer at a time, from any thread."""

    def __init__(self, output: IO[bytes]) -> None:
        self._output = output
        self._lock = threading.Lock()

    def say(self, said: DriverReply) -> None:
        """Write one line."""
        with self._lock:
            self._output.write(msgspec.json.encode(said) + b"\n")
            self._output.flush()

    def refuse(self, number: int, error: LabError) -> None:
        """Say why something failed, and what it may have done."""
        self.say(DriverReply(number, error.code, error.message[:2000], error.effect.value))


class TriedDriver:
    """One driver: an action runs on a thread of its own, so that it can be watched and stopped."""

    def __init__(self, driver: Driver[Any, Any], mouth: AnswerStream) -> None:
        self._driver = driver
        self._mouth = mouth
        self._is_connected = False
        self._connecting = threading.Lock()

    def take(self, wish: DriverCall) -> None:
        """Begin one wish."""
        work = {"act": self._act, "read": self._read, "stop": self._stop}[wish.sort]
        threading.Thread(target=self._answer, args=(wish, work), daemon=True).start()

    def _answer(self, wish: DriverCall, work: Any) -> None:  # noqa: ANN401 - one of three methods
        try:
            self._mouth.say(DriverReply(wish.number, data=work(wish)))
        except LabError as error:
            self._mouth.refuse(wish.number, error)
        except Exception as error:  # noqa: BLE001 - a driver's bug is what the author looks for
            text = f"{type(error).__name__}: {error}"
            bug = DeviceError(text, code="driver.bug", effect=Effect.UNKNOWN)
            self._mouth.refuse(wish.number, bug)

    def _connect(self) -> None:
        with self._connecting:
            if not self._is_connected:
                self._driver.connect()
                self._is_connected = True

    def _act(self, wish: DriverCall) -> dict[str, Any]:
        self._connect()
        self._driver.clear_stop()
        try:
            report = call_action(self._driver, wish.name, wish.args)
        except LabError:
            self._look()
            raise
        told = [
            {"name": one.name, "format": one.format, "size_bytes": len(one.data)}
            for one in report.files
        ]
        found: dict[str, Any] = msgspec.to_builtins(msgspec.structs.replace(report, files=()))
        return found | {"files": told}

    def _read(self, wish: DriverCall) -> dict[str, Any]:
        """Ask for every status; one that is refused does not hide the others.

        Where the instrument has fallen silent the others are not asked.
        """
        del wish
        self._connect()
        values, problems = {}, {}
        for one in self._driver.spec.statuses if self._driver.spec else ():
            try:
                values[one.name] = msgspec.to_builtins(read_status(self._driver, one.name))
            except LabError as error:
                problems[one.name] = error.message[:500]
                self._look()
                if not self._is_connected:
                    break
        return {"values": values, "problems": problems}

    def _stop(self, wish: DriverCall) -> dict[str, Any]:
        del wish
        self._driver.stop()
        return {}

    def _look(self) -> None:
        """Ask who answers after a failure; a silent instrument is connected anew next time."""
        try:
            self._driver.identify()
        except LabError:
            self._is_connected = False
            self._driver.close()


if __name__ == "__main__":
    main()
