"""A drain that a motor opens by a quarter turn, and what is known of one run through it.

The valve stands at its motor's zero when it is closed. That is read back and never taken for
granted. A motor that has lost its power counts from where it stands: after a silence while the
drain was open, or a zero to which nobody sent it, its zero proves nothing, until a count away from
zero shows that it was kept.

Source:
    Uni-Lab-OS, public device file `unilabos/devices/separator/chinwe.py`: 3200 pulses a turn,
    800 for the quarter turn between open and closed; counts as in `_emm`.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from drivers.base import Driver
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
class Run:
    """What runs through the drain once: what is asked for, and what is seen of it."""

    volume_ul: float
    rate_ul_s: float
    off_ul: float
    """How far time by rate may be from the volume."""

    falls: bool
    """What the signal does at the boundary; else it rises."""

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
        return round(self.rate_ul_s * (time.monotonic() - self.began_s), 1)


def planned(
    volume_ul: float, *, falls: bool, rate_ul_s: float, tolerance_ratio: float, poll_s: float
) -> Run:
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
    return Run(volume_ul=volume_ul, rate_ul_s=rate_ul_s, off_ul=off_ul, falls=falls)


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
    may_have_lost_count: bool = False
    """Its motor fell silent in mid-drain, or tells zero unasked, and nothing else since."""

    is_to_open: bool = False
    """It was told to open, and not to close since."""

    has_left: bool = False
    """It has told a place away from its zero since it was told to open."""

    def count(self) -> int:
        """Return where it stands; one that is away from its zero has kept its count.

        Zero is told twice before it counts, and so is what ends a doubt: a frame of a motor has
        no check that shows a bit that was flipped on its way.
        """
        first = count = self.motor.position()
        if self.may_have_lost_count or _is_near(first):
            count = self.motor.position()
        if not _is_near(first) and not _is_near(count):
            self.may_have_lost_count = False
            self.has_left = True
        elif _is_near(count) and self.is_to_open and self.has_left:
            self.may_have_lost_count = True
        return count

    def is_closed(self) -> bool | None:
        """Tell whether it is at its zero; None: its motor may have lost its count."""
        is_at_zero = _is_near(self.count())
        return None if self.may_have_lost_count else is_at_zero

    def open(self) -> None:
        """Send it to its open place."""
        self.is_to_open, self.has_left = True, False
        self.motor.go_to(self.opens, self.speed_rpm, OPEN_PULSES)

    def watch(self, run: Run) -> None:
        """See that it comes to its open place in time, and stays there.

        Raises:
            DeviceError: It does not.
        """
        count = self.count()
        if abs(abs(count) - OPEN_COUNTS) <= NEAR_COUNTS:
            run.is_open = True
        elif run.is_open or time.monotonic() - run.began_s > self.limit_s:
            self.may_have_lost_count |= _is_near(count)
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
        is_away = True
        with suppress(DeviceTimeoutError, RejectedError, FrameError):
            is_away = not _is_near(self.count())
        try:
            self.tell_to_close()
        except DeviceTimeoutError:
            self.may_have_lost_count |= is_away
        except (RejectedError, FrameError):
            pass  # where the valve stands tells whether it was done
        self.await_zero()
        if self.may_have_lost_count:
            raise DeviceError(
                "its motor tells zero, and may have lost its power and its count while it was open",
                code="device.drain_open",
            )

    def tell_to_close(self) -> None:
        """Send it to its zero; a motor that has stalled, or has let go, is made ready for it."""
        self.is_to_open = False
        try:
            self.motor.go_to(self.opens, self.speed_rpm, 0)
        except RejectedError:
            if self.motor.status() & (HAS_STALLED | IS_PROTECTED):
                self.motor.clear_stall()
            self.motor.enable()
            self.motor.go_to(self.opens, self.speed_rpm, 0)

    def await_zero(self) -> None:
        """Return once it stands at its zero, stopped or not.

        Raises:
            DeviceError: It does not come there in time.
        """
        deadline_s = time.monotonic() + self.limit_s
        while not _is_near(count := self.count()):
            if time.monotonic() > deadline_s:
                raise DeviceError(
                    f"the valve stands {count} counts from where it is closed",
                    code="device.drain_open",
                    context={"valve_count": count},
                )
            self.driver.rest(self.poll_s)


def _is_near(count: int) -> bool:
    return abs(count) <= NEAR_COUNTS
