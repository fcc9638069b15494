"""A drain that a motor opens by a quarter turn, and what is known of one run through it.

The valve stands at its motor's zero when it is closed. That is read back and never taken for
granted: a motor that has lost its power counts from where it stands. So a zero proves nothing
until a person has looked since the driver began, nor from then on that the motor tells it unasked,
after a silence while the drain was open, or without holding its shaft.

Source:
    Uni-Lab-OS, public device file `unilabos/devices/separator/chinwe.py`: 3200 pulses a turn,
    800 for the quarter turn between open and closed; counts as in `_emm`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from drivers.base import Driver, Report
from drivers.processing._emm import (
    COUNTS_PER_TURN,
    HAS_STALLED,
    IS_ENABLED,
    IS_PROTECTED,
    PULSES_PER_TURN,
    Direction,
    Motor,
)
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    FrameError,
    PreconditionError,
    RejectedError,
)

OPEN_PULSES, OPEN_COUNTS = PULSES_PER_TURN // 4, COUNTS_PER_TURN // 4
NEAR_COUNTS = 364
"""Two degrees: how far the valve may stand from its place."""

LONGEST_S = 3400.0
"""Longest time that a drain may take."""

LOOK = "look at the drain, close it by hand if it is open, and confirm that it is closed"


def make_ready(motor: Motor) -> None:
    """Let a motor that stands hold and move.

    Raises:
        RejectedError: It is in alarm.
    """
    flags = motor.status()
    if flags & (HAS_STALLED | IS_PROTECTED):
        raise RejectedError(
            f"motor {motor.address} has stalled: free it, and switch it off and on",
            code="device.alarm",
            context={"flags": flags},
        )
    if not flags & IS_ENABLED:
        motor.enable()


@dataclass(slots=True, kw_only=True)
class DrainRun:
    """What runs through the drain once: what is asked for, and what is seen of it."""

    volume_ul: float
    rate_ul_s: float
    off_ul: float
    """How far time by rate may be from the volume."""

    falls: bool
    """What the signal does at the boundary; else it rises."""

    now_s: Callable[[], float]
    """The clock of its driver: lab time."""

    began_s: float = 0.0
    is_taken: bool = False
    """The valve has taken the command to open."""

    is_open: bool = False
    seen: dict[str, Any] = field(default_factory=dict)
    """Evidence, as it grows."""

    def by_time_ul(self) -> float:
        """Return what has run by time and rate since the valve was told to open.

        It is told to close as long before it is closed as it was told to open before it was
        open, so the two turns make up for each other.
        """
        return round(self.rate_ul_s * (self.now_s() - self.began_s), 1)

    def report(self) -> Report:
        """Report what went where both witnesses agree.

        Raises:
            DeviceError: They do not; nobody knows.
        """
        by_time_ul = self.seen["by_time_ul"]
        if self.seen["boundary"] and abs(by_time_ul - self.volume_ul) <= self.off_ul:
            return Report(by_time_ul, self.seen, resolution_ul=2 * self.off_ul)
        what = "was seen" if self.seen["boundary"] else "was not seen"
        raise DeviceError(
            f"{self.volume_ul:g} µL were to be drained; the boundary {what} when {by_time_ul:g} µL "
            f"had run by time and rate, ± {self.off_ul:g} is allowed: the drain is closed, look "
            "what is in which vessel",
            code="device.no_boundary",
            context=self.seen,
        )


def planned(
    volume_ul: float,
    *,
    falls: bool,
    rate_ul_s: float,
    tolerance_ratio: float,
    poll_s: float,
    now_s: Callable[[], float],
) -> DrainRun:
    """Return a run that its two witnesses can tell apart from another.

    Raises:
        PreconditionError: Too little to be told by looks so far apart, or too much for the time.
    """
    off_ul, least_ul = volume_ul * tolerance_ratio, rate_ul_s * poll_s
    if (volume_ul + off_ul) / rate_ul_s > LONGEST_S:
        raise PreconditionError(
            f"{volume_ul:g} µL at {rate_ul_s:g} µL/s takes over {LONGEST_S:g} s",
            code="device.rate_out_of_range",
        )
    if off_ul < least_ul:
        raise PreconditionError(
            f"{volume_ul:g} ± {off_ul:g} µL is to be told; between two looks at the sensor "
            f"{least_ul:g} µL run",
            code="device.volume_too_small",
        )
    return DrainRun(
        volume_ul=volume_ul, rate_ul_s=rate_ul_s, off_ul=off_ul, falls=falls, now_s=now_s
    )


@dataclass(slots=True, kw_only=True)
class Drain:
    """The valve, on behalf of its driver."""

    driver: Driver[Any, Any]
    motor: Motor
    opens: Direction
    speed_rpm: int
    limit_s: float
    """Longest quarter turn."""

    poll_s: float
    is_confirmed: bool = False
    """A person has seen it closed since its driver began, and nothing put its zero in doubt."""

    may_be_open: bool = False
    """It was told to open, and is not shown to be closed since."""

    is_sent_to_zero: bool = False
    """It was told to close, and not to open since."""

    is_zero_odd: bool = False
    """A zero that is told does not come from where it was sent."""

    def confirm(self) -> None:
        """Take the place where it stands for closed, and hold it there. Nothing moves.

        Raises:
            RejectedError: Its motor is in alarm.
            DeviceError: It tells another place than zero, or does not hold.
        """
        self.is_confirmed = False
        make_ready(self.motor)
        self.motor.set_zero()
        self.may_be_open = self.is_zero_odd = False
        self.is_confirmed = _is_near(self.count())
        self.make_sure()

    def count(self) -> int:
        """Return where it stands by its motor; one that is away from zero has kept its count.

        Zero is told twice before it counts, and so is what ends a doubt: a frame of a motor has
        no check that shows a bit that was flipped on its way.
        """
        try:
            first = count = self.motor.position()
            if _is_near(first) or (self.is_zero_odd and self.is_sent_to_zero):
                count = self.motor.position()
        except DeviceError:
            self.is_zero_odd |= self.may_be_open
            raise
        if not _is_near(first) and not _is_near(count):
            self.is_zero_odd = self.may_be_open and not self.is_sent_to_zero
        elif _is_near(count) and self.is_zero_odd:
            self.is_confirmed = False
        return count

    def is_closed(self) -> bool | None:
        """Tell whether it is at its zero; None: nobody knows where that is."""
        is_at_zero = _is_near(self.count())
        return is_at_zero if self._is_known() else None

    def refuse_unless_closed(self) -> None:
        """Refuse to begin anything while it may be open.

        Raises:
            RejectedError: It is not shown to be closed.
        """
        if not self.is_closed():
            raise RejectedError(
                f"the drain is not shown to be closed: {LOOK}",
                code="device.drain_open",
                context={"valve_count": self.count()},
            )

    def open(self) -> None:
        """Send it to its open place."""
        self.may_be_open, self.is_sent_to_zero, self.is_zero_odd = True, False, False
        self.motor.go_to(self.opens, self.speed_rpm, OPEN_PULSES)

    def watch(self, run: DrainRun) -> None:
        """See that it comes to its open place in time, and stays there.

        Raises:
            DeviceError: It does not.
        """
        count = self.count()
        if abs(abs(count) - OPEN_COUNTS) <= NEAR_COUNTS:
            run.is_open = True
        elif run.is_open or run.now_s() - run.began_s > self.limit_s:
            raise DeviceError(
                "the valve does not stand where the drain is open",
                code="device.not_reached",
                context={"valve_count": count},
            )

    def close(self) -> None:
        """Close it and make sure of it, stopped or not.

        Raises:
            DeviceError: It is not shown to be closed.
        """
        with suppress(DeviceTimeoutError, RejectedError, FrameError):
            self.begin_to_close()  # where the valve stands tells whether it was done
        self.make_sure()

    def begin_to_close(self) -> None:
        """See where it stands, then send it to its zero, whatever was seen.

        A motor that was sent to open and tells zero has lost its count, or has not moved.

        Raises:
            DeviceError: It was not taken. One that has let go is not moved: somebody may have
                turned it.
        """
        if not self.is_sent_to_zero:
            self.is_sent_to_zero, self.is_zero_odd = True, self.may_be_open
        with suppress(DeviceError):
            self.count()
        try:
            self.motor.go_to(self.opens, self.speed_rpm, 0)
        except RejectedError:
            if not self.motor.status() & (HAS_STALLED | IS_PROTECTED):
                raise
            self.motor.clear_stall()
            self.motor.enable()
            self.motor.go_to(self.opens, self.speed_rpm, 0)
        except DeviceError:
            self.is_zero_odd |= self.may_be_open
            raise

    def make_sure(self) -> None:
        """Return once it stands at its zero, stopped or not.

        Raises:
            DeviceError: It does not come there in time, or nobody knows where its zero is.
        """
        deadline_s = self.driver.deadline_s(self.limit_s)
        while not _is_near(count := self.count()):
            if self.driver.now_s() > deadline_s:
                self.is_sent_to_zero = False
                raise DeviceError(
                    f"the valve stands {count} counts from where it is closed",
                    code="device.drain_open",
                    context={"valve_count": count},
                )
            self.driver.rest(self.poll_s)
        if not self._is_known():
            raise DeviceError(
                "its motor tells zero, and nobody has seen that the drain is closed there since "
                "its driver or its motor began",
                code="device.drain_open",
                context={"valve_count": count},
            )
        self.may_be_open &= not self.is_sent_to_zero

    def _is_known(self) -> bool:
        """Tell whether its zero is where it is closed; a motor that has let go has no zero."""
        if not self.motor.status() & IS_ENABLED:
            self.is_confirmed = False
        return self.is_confirmed


def _is_near(count: int) -> bool:
    return abs(count) <= NEAR_COUNTS
