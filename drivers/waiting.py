"""Waits for readings, and leaves things off when the waiting fails.

All times are lab time (`Driver.now_s`).
"""

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
    | {"device.no_progress", "device.setpoint_lost", "device.stalled"}
    | {DeviceStoppedError.default_code, RejectedError.default_code}
)
"""Codes of failures after which the instrument still answers and can say how far it came."""


PROGRESS_RATIO = 1 / 12
"""A reading that comes no nearer for this share of its time limit makes no progress."""

SHORTEST_PROGRESS_S = 60.0
TURNED_S = 30.0
"""How long a reading that was on its way may go back before that counts as no progress."""

MOST_OFTEN_S = 0.02
"""Shortest real time between two looks of a wait, however fast lab time runs."""


@dataclass(frozen=True, slots=True)
class WantedReading:
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
    wanted: WantedReading,
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
    deadline_s = driver.deadline_s(limit_s)
    progress = Progress(wanted, limit_s)
    near_since_s: float | None = None
    while True:
        reading = read()
        now_s = driver.now_s()
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
        progress.note(reading, now_s)
        pause(polled_s(driver, poll_s))


def polled_s(driver: Driver[Any, Any], poll_s: float) -> float:
    """Return how long to wait between two looks, lab time: the line is no faster than it is."""
    return max(poll_s, MOST_OFTEN_S * (driver.pace if driver.pace > 1 else 0.0))


class Progress:
    """Watches that a reading comes nearer to what is wanted.

    It makes no progress where it comes no nearer for a twelfth of the time limit, or where it has
    come nearer, turns round short of the goal and goes away for half a minute. One that has gone
    past the goal may swing back in its own time.
    """

    def __init__(self, wanted: WantedReading, limit_s: float) -> None:
        self._wanted = wanted
        self._window_s = max(SHORTEST_PROGRESS_S, limit_s * PROGRESS_RATIO)
        self._first: float | None = None
        self._nearest = float("inf")
        self._nearest_at_s = self._step_at_s = 0.0
        self._step_from = float("inf")
        self._was_past = False

    def note(self, reading: float, at_s: float) -> None:
        """Take one reading.

        Raises:
            DeviceError: Code `device.no_progress`.
        """
        gap = reading - self._wanted.value
        if self._first is None:
            self._first = gap
        self._was_past |= gap * self._first <= 0
        if abs(gap) < self._nearest:
            self._nearest, self._nearest_at_s = abs(gap), at_s
        if self._wanted.accepts(reading) or self._step_from - abs(gap) >= self._step:
            self._step_from, self._step_at_s = abs(gap), at_s
        if at_s - self._step_at_s > self._window_s:
            raise self._error(reading, f"it comes no nearer for {self._window_s:g} s")
        if self._has_turned(gap) and at_s - self._nearest_at_s > TURNED_S:
            raise self._error(reading, f"it goes away again for {TURNED_S:g} s")

    @property
    def _step(self) -> float:
        return self._wanted.tolerance / 4

    def _has_turned(self, gap: float) -> bool:
        """Say whether it was on its way and has come back by more than a reading wavers."""
        if self._first is None or self._was_past:
            return False
        least = max(self._wanted.tolerance, 0.02 * abs(self._first))
        has_come = abs(self._first) - self._nearest >= least
        return has_come and abs(gap) - self._nearest >= least

    def _error(self, reading: float, why: str) -> DeviceError:
        return DeviceError(
            f"{self._wanted} is wanted, the reading is {reading:g}, and {why}: look whether the "
            "device still acts and its sensor is in place",
            code="device.no_progress",
            context={"reading": reading},
        )


def watch_reading(
    driver: Driver[Any, Any],
    read: Callable[[], float],
    wanted: WantedReading,
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
    last_good_s = driver.now_s()
    end_s = last_good_s + duration_s
    while (left_s := end_s - driver.now_s()) > 0:
        driver.pause(min(left_s, polled_s(driver, poll_s)))
        reading = read()
        if wanted.accepts(reading):
            last_good_s = driver.now_s()
        elif driver.now_s() - last_good_s > grace_s:
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
    deadline_s = driver.deadline_s(limit_s)
    while not is_so():
        if driver.now_s() > deadline_s:
            raise DeviceError(f"{what}: not so after {limit_s:g} s", code="device.slow")
        driver.pause(polled_s(driver, poll_s))
    driver.pause(0)


def refuse_unless_near(read: float, wanted: WantedReading) -> None:
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
    driver: Driver[Any, Any] | None = None,
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
        driver: By whose clock it lasts; None: in real time.
    """
    now_s = time.monotonic if driver is None else driver.now_s
    started_s = now_s()
    try:
        yield
    except DeviceError as error:
        error.context[lasted] = round(now_s() - started_s, 3)
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
class TemperatureControl:
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
        wanted = WantedReading(temperature_c, tolerance_c, "°C", config.settle_s)
        if self.before is not None:
            self.before(temperature_c)
        with once_started(self.end, self.describe, driver=self.driver):
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
        wanted = WantedReading(temperature_c, tolerance_c, "°C")
        refuse_unless_near(reading_c, wanted)
        if self.before is not None:
            self.before(temperature_c)
        with once_started(self.end, self.describe, lasted="held_s", driver=self.driver):
            self._begin(temperature_c)
            started_s = self.driver.now_s()
            watch_reading(
                self.driver,
                self.read,
                wanted,
                duration_s=duration_s,
                poll_s=config.poll_s,
                grace_s=config.grace_s,
            )
            held_s = round(self.driver.now_s() - started_s, 3)
            return Report(evidence={**self.describe(), "held_s": held_s})

    def _begin(self, temperature_c: float) -> None:
        try:
            self.begin(temperature_c)
        except RejectedError:
            self.driver.pause(0)  # a stop from another thread is told as such
            raise
