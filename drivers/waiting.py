"""Waits for readings, and leaves things off when the waiting fails."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from drivers.base import DeviceStoppedError, Driver, Report
from labweb.domain.errors import DeviceError, Effect, PreconditionError, RejectedError

KNOWN_ENDS = frozenset(
    {"device.not_reached", "device.not_held", "device.slow", "device.alarm"}
    | {DeviceStoppedError.default_code, RejectedError.default_code}
)
"""Codes of failures after which the instrument still answers and can say how far it came."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """A wanted reading, and how far from it is near enough."""

    value: float
    tolerance: float
    unit: str
    """As a person reads it."""

    settle_s: float = 0.0
    """How long it must stay near enough before it counts as reached."""

    def accepts(self, reading: float) -> bool:
        """Tell whether a reading is near enough."""
        return abs(reading - self.value) <= self.tolerance

    def __str__(self) -> str:
        return f"{self.value:g} ± {self.tolerance:g} {self.unit}"


def refuse_beyond(name: str, value: float, low: float, high: float) -> None:
    """Refuse what is beyond the limits of this device, before a byte is sent.

    Raises:
        PreconditionError: It is; nothing is clamped.
    """
    if not low <= value <= high:
        raise PreconditionError(
            f"{name} {value:g} was asked for; this device is limited to {low:g} to {high:g}",
            code="device.limit",
            context={"limits": [low, high]},
        )


def refuse_between_steps(name: str, value: float, step: float) -> int:
    """Return the whole number of steps, and refuse what lies between two of them.

    Raises:
        PreconditionError: It does; nothing is rounded.

    Example:
        >>> refuse_between_steps("voltage", 1.8, 0.1)
        18
    """
    steps = round(value / step)
    if abs(value / step - steps) > 1e-6:  # what binary fractions leave
        raise PreconditionError(
            f"{name} {value:g} was asked for; this device goes in steps of {step:g}",
            code="device.resolution",
            context={"step": step},
        )
    return steps


def refuse_untaken(name: str, taken: float, asked: float, *, resolution: float) -> None:
    """Refuse to go on with a setpoint that the instrument did not take.

    Raises:
        RejectedError: It stands further away than its resolution.
    """
    if abs(taken - asked) > resolution:
        raise RejectedError(
            f"{name} is {taken:g} after writing {asked:g}", context={"taken": taken}
        )


def await_reading(
    driver: Driver[Any, Any],
    read: Callable[[], float],
    wanted: Wanted,
    *,
    limit_s: float,
    poll_s: float,
    is_stopping: bool = False,
) -> float:
    """Return the reading once it has stayed near enough for its settling time.

    Running down may be watched while the device is stopped: `is_stopping` says so.

    Raises:
        DeviceStoppedError: Somebody stopped the device.
        DeviceError: Not reached in time, or the reading failed.
    """
    pause = driver.rest if is_stopping else driver.pause
    deadline_s = time.monotonic() + limit_s
    near_since_s: float | None = None
    while True:
        reading = read()
        now_s = time.monotonic()
        if not wanted.accepts(reading):
            near_since_s = None
        elif near_since_s is None:
            near_since_s = now_s
        if near_since_s is not None and now_s - near_since_s >= wanted.settle_s:
            pause(0)
            return reading
        if now_s > deadline_s:
            raise DeviceError(
                f"{wanted} not reached in {limit_s:g} s: reading is {reading:g}",
                code="device.not_reached",
            )
        pause(poll_s)


def watch_reading(
    driver: Driver[Any, Any],
    read: Callable[[], float],
    wanted: Wanted,
    *,
    duration_s: float,
    poll_s: float,
    grace_s: float,
) -> None:
    """Watch for a time that a reading stays near enough; it may leave for the grace time.

    Raises:
        DeviceStoppedError: Somebody stopped the device.
        DeviceError: It left for longer, or the reading failed.
    """
    last_good_s = time.monotonic()
    end_s = last_good_s + duration_s
    while (left_s := end_s - time.monotonic()) > 0:
        driver.pause(min(left_s, poll_s))
        reading = read()
        if wanted.accepts(reading):
            last_good_s = time.monotonic()
        elif time.monotonic() - last_good_s > grace_s:
            raise DeviceError(f"reading left {wanted}: {reading:g}", code="device.not_held")
    driver.pause(0)


def await_true(
    driver: Driver[Any, Any],
    is_so: Callable[[], bool],
    what: str,
    *,
    limit_s: float,
    poll_s: float,
) -> None:
    """Return once the question is answered with yes.

    Raises:
        DeviceStoppedError: Somebody stopped the device.
        DeviceError: Not so in time, or the question failed.
    """
    deadline_s = time.monotonic() + limit_s
    while not is_so():
        if time.monotonic() > deadline_s:
            raise DeviceError(f"{what}: not so after {limit_s:g} s", code="device.slow")
        driver.pause(poll_s)
    driver.pause(0)


def refuse_unless_near(read: float, wanted: Wanted) -> None:
    """Refuse to hold what is not reached yet.

    Raises:
        PreconditionError: The reading is not near enough; nothing was started.
    """
    if not wanted.accepts(read):
        raise PreconditionError(
            f"reading is {read:g}, not within {wanted}: bring it there first",
            code="device.not_at_temperature",
            context={"temperature_c": read},
        )


@contextmanager
def once_started(
    turn_off: Callable[[], object],
    describe: Callable[[], Mapping[str, Any]] | None,
    *,
    lasted: str = "duration_s",
) -> Iterator[None]:
    """Guard what follows the command that started something.

    A failure inside turns it off again, and `context` says after how long. Where the
    instrument still answers, `describe` says how far it came and the effect is PARTIAL. After
    a broken link it is UNKNOWN, even when the last exchange moved nothing by itself.

    Args:
        turn_off: Sends what ends the action; `context["not_turned_off"]` says if that failed.
        describe: Reads what is true once it is off. None: nobody can tell how far it came,
            and the effect is UNKNOWN.
        lasted: Name of the time in `context`.
    """
    started_s = time.monotonic()
    try:
        yield
    except DeviceError as error:
        error.context[lasted] = round(time.monotonic() - started_s, 3)
        error.effect = Effect.UNKNOWN
        try:
            turn_off()
            if describe is not None and error.code in KNOWN_ENDS:
                error.context.update(describe())
                error.effect = Effect.PARTIAL
        except DeviceError as second:
            error.context["not_turned_off"] = second.message
        raise


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """How a driver brings a temperature to a setpoint and keeps it there.

    The times are settings of the driver: `settle_s`, `reach_limit_s`, `grace_s` and `poll_s`.
    """

    driver: Driver[Any, Any]
    read: Callable[[], float]
    """Reading, or the reason why it is not controlled any more."""

    begin: Callable[[float], object]
    """Sends the setpoint and what starts; what fails here is ended."""

    end: Callable[[], object]
    describe: Callable[[], Mapping[str, Any]]
    """Reads what is true: the evidence, and how far it came."""

    before: Callable[[float], object] | None = None
    """Comes before `begin`, and says itself what its failure may have done."""

    def reach(self, temperature_c: float, tolerance_c: float) -> Report:
        """Begin, and return once the reading has stayed within tolerance.

        Raises:
            DeviceError: As `await_reading`, after it was ended (PARTIAL or UNKNOWN).
        """
        config = self.driver.config
        wanted = Wanted(temperature_c, tolerance_c, "°C", config.settle_s)
        if self.before is not None:
            self.before(temperature_c)
        with once_started(self.end, self.describe):
            self._begin(temperature_c)
            await_reading(
                self.driver,
                self.read,
                wanted,
                limit_s=config.reach_limit_s,
                poll_s=config.poll_s,
            )
            return Report(evidence=dict(self.describe()))

    def hold(
        self, reading_c: float, duration_s: float, temperature_c: float, tolerance_c: float
    ) -> Report:
        """Keep what is reached for a while, and watch it; evidence `held_s`.

        Args:
            reading_c: What it was right before.
            duration_s: How long.
            temperature_c: Setpoint.
            tolerance_c: How far the reading may be from it.

        Raises:
            PreconditionError: The reading is not within tolerance (NONE).
            DeviceError: As `watch_reading`, after it was ended (PARTIAL or UNKNOWN).
        """
        config = self.driver.config
        wanted = Wanted(temperature_c, tolerance_c, "°C")
        refuse_unless_near(reading_c, wanted)
        if self.before is not None:
            self.before(temperature_c)
        with once_started(self.end, self.describe, lasted="held_s"):
            self._begin(temperature_c)
            started_s = time.monotonic()
            watch_reading(
                self.driver,
                self.read,
                wanted,
                duration_s=duration_s,
                poll_s=config.poll_s,
                grace_s=config.grace_s,
            )
            held_s = round(time.monotonic() - started_s, 3)
            return Report(evidence={**self.describe(), "held_s": held_s})

    def _begin(self, temperature_c: float) -> None:
        try:
            self.begin(temperature_c)
        except RejectedError:
            self.driver.pause(0)  # a stop from another thread is told as such
            raise
