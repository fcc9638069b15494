"""Gantry behind a GRBL 1.1 controller.

Protocol: GRBL 1.1 lines, 115200 8N1, LF; answered by ok or error:N; ALARM:N comes by itself.
Quality: bronze, simulated instrument.
Safe state: feed held and what was queued forgotten; on a lost link it ends the move it has begun.

One move is sent at a time and watched to its end: the queue of the controller is never longer.
Places are machine coordinates, and only a controller that locks itself until it was homed ($22) is
driven, because nobody else can tell whether they are true. Lines have no checksum.

No accuracy is stated: Grbl counts steps, and what a step is worth is the mechanics' doing.

Source:
    Grbl v1.1 wiki: "Interface" (real-time commands, homing) and "Configuration" ($13, $22, $130 to
    $132); frames in `_grbl`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.gantry import Gantry
from drivers.logistics._grbl import (
    ASK,
    END,
    HOLD,
    HOME,
    IDENTIFY,
    RESET,
    SETTINGS,
    STANDING,
    VERSION,
    GrblStatus,
    Position,
    decode_answer,
    decode_report,
    decode_settings,
    encode_move,
    is_refusal,
)
from drivers.transports.base import ByteTransport
from drivers.waiting import await_true, once_started, refuse_beyond
from labweb.domain.errors import (
    DefinitionError,
    DeviceError,
    DeviceTimeoutError,
    RejectedError,
)

INCHES, HOMING, TRAVEL = 13, 22, (130, 131, 132)
"""Settings: reports in inches, homing cycle, travel of each axis."""

NEAR_MM = 0.05
"""Steps of the axes are finer than this."""

ANSWER_S = 2.0

Place = Annotated[float, Range(-3000.0, 3000.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One gantry, and the box in which this lab lets its tool move, in machine coordinates."""

    low_x_mm: Place
    high_x_mm: Place
    low_y_mm: Place
    high_y_mm: Place
    low_z_mm: Place
    high_z_mm: Place
    max_speed_mm_s: Annotated[float, Range(0.1, 1000.0)]
    """Fastest move that tool and load stand."""

    wake_s: Annotated[float, Range(0.0, 10.0)] = 2.0
    """Time that the board needs after its port was opened, which resets many."""

    home_limit_s: Annotated[float, Range(0.1, 500.0)] = 120.0
    """Longest time to find the zero of every axis."""

    move_limit_s: Annotated[float, Range(0.1, 1700.0)] = 300.0
    """Longest time of a move."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.2


class GrblGantry(Driver[ByteTransport, Config], Gantry):
    """One gantry."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def __init__(self, transport: ByteTransport, config: Mapping[str, Any]) -> None:
        """Hold transport and settings.

        Raises:
            DefinitionError: As the base class, or the box is inside out.
        """
        super().__init__(transport, config)
        for axis, low, high in self._box:
            if low > high:
                raise DefinitionError(
                    f"low_{axis}_mm is {low:g}, above high_{axis}_mm, {high:g}",
                    code="driver.config",
                )

    def identify(self) -> None:
        """Ask for version and settings.

        Raises:
            RejectedError: Not GRBL 1.1, no homing cycle, reports in inches, or travel that is
                shorter than the box of the settings.
        """
        self.rest(self.config.wake_s)
        found = self._ask(IDENTIFY)
        if not any(line.startswith(VERSION) for line in found):
            raise RejectedError(f"{self.transport.line} is no GRBL 1.1: {found}")
        settings = decode_settings(self._ask(SETTINGS))
        if not settings.get(HOMING):
            raise RejectedError(
                "the homing cycle is off: set $22=1, without it nobody knows where the tool stands"
            )
        if settings.get(INCHES):
            raise RejectedError("the controller reports inches: set $13=0")
        for number, (axis, low, high) in zip(TRAVEL, self._box, strict=True):
            travel_mm = settings.get(number, 0.0)
            if high - low > travel_mm:
                raise RejectedError(
                    f"axis {axis} is to move {high - low:g} mm, and its travel is {travel_mm:g} mm "
                    f"(${number})"
                )

    def halt(self) -> None:
        """Hold the feed, wait until the axes stand, and forget what is queued.

        Raises:
            DeviceError: They do not come to stand.
        """
        seen = self._seen()
        if seen.state in STANDING:
            return
        if seen.state != "Home":  # homing knows no hold
            self.transport.send(HOLD)
            for _ in range(int(ANSWER_S / self.config.poll_s) + 1):
                seen = self._seen()
                if seen.has_stopped or seen.state in STANDING:
                    break
                self.rest(self.config.poll_s)
            else:
                raise DeviceError("the axes do not come to stand", code="device.slow")
        if seen.state not in STANDING:
            self.transport.exchange(RESET, until=b"]\r\n", timeout_s=ANSWER_S)

    @status(every_s=1.0)
    def x_mm(self) -> float:
        """Tell the place on the first axis."""
        return self._seen().place_mm[0]

    @status(every_s=1.0)
    def y_mm(self) -> float:
        """Tell the place on the second axis."""
        return self._seen().place_mm[1]

    @status(every_s=1.0)
    def z_mm(self) -> float:
        """Tell the place on the third axis."""
        return self._seen().place_mm[2]

    @status(every_s=1.0)
    def is_moving(self) -> bool:
        """Tell whether an axis moves."""
        seen = self._seen()
        return seen.state not in STANDING and not seen.has_stopped

    @status(every_s=1.0)
    def machine_state(self) -> str:
        """Tell the state of the controller: Idle, Run, Hold, Home, Alarm, Door, Check, Sleep."""
        return self._seen().state

    @action(timeout_s=600.0, recovery="R3", hazards=("moving_parts",))
    def initialize(self) -> Report:
        """Run the homing cycle, which also unlocks the controller.

        Raises:
            RejectedError: It moves, or refuses (NONE).
            DeviceError: A switch was not found, or stopped: the position is lost (UNKNOWN).

        Effect:
            Each axis runs to its switch; the way there has to be free.
        """
        self.refuse_if_stopped()
        with before_acting():
            if (state := self._seen().state) not in {"Idle", "Alarm"}:
                raise RejectedError(f"the controller is in state {state}", context={"state": state})
        with once_started(self.halt, None, driver=self):
            frame = self._home()
        if is_refusal(frame):
            decode_answer(frame)
        with once_started(self.halt, None, driver=self):
            decode_answer(frame)
            return Report(evidence=self._where())

    @action(timeout_s=1800.0, recovery="R2", hazards=("moving_parts",))
    def move_to(
        self,
        x_mm: Place,
        y_mm: Place,
        z_mm: Place,
        speed_mm_s: Annotated[float, Range(0.1, 1000.0)],
    ) -> Report:
        """Move in a straight line, and return once the tool stands there.

        Raises:
            PreconditionError: Out of the box, or faster than this lab allows (NONE).
            RejectedError: Not idle, not homed, or refused (NONE).
            DeviceError: It did not come there, or stopped: the axes stand, and `context` says
                where (PARTIAL); after an alarm or a lost answer UNKNOWN.

        Effect:
            The tool, and what it carries, are at this place.
        """
        self.refuse_if_stopped()
        place = (x_mm, y_mm, z_mm)
        for value, (axis, low, high) in zip(place, self._box, strict=True):
            refuse_beyond(axis, value, low, high)
        refuse_beyond("speed", speed_mm_s, 0.0, self.config.max_speed_mm_s)
        with before_acting():
            if (state := self._seen().state) != "Idle":
                what = "initialize it first" if state == "Alarm" else "it has to be idle"
                raise RejectedError(
                    f"the controller is in state {state}: {what}", context={"state": state}
                )
        try:
            self._ask(encode_move(place, speed_mm_s))
        except RejectedError:
            raise
        except DeviceError:
            with once_started(self.halt, None, driver=self):
                raise
        with once_started(self.halt, self._where, driver=self):
            await_true(
                self,
                lambda: self._stands_at(place),
                "move ended",
                limit_s=self.config.move_limit_s,
                poll_s=self.config.poll_s,
            )
            return Report(evidence=self._where())

    @action(timeout_s=30.0, recovery="R1")
    def stop_moving(self) -> Report:
        """End the move where it is.

        Effect:
            The axes stand.
        """
        with once_started(self.halt, self._where, driver=self):
            self.halt()
            return Report(evidence=self._where())

    @property
    def _box(self) -> tuple[tuple[str, float, float], ...]:
        config = self.config
        return (
            ("x", config.low_x_mm, config.high_x_mm),
            ("y", config.low_y_mm, config.high_y_mm),
            ("z", config.low_z_mm, config.high_z_mm),
        )

    def _home(self) -> bytes:
        """Send the homing cycle and return what ended it; a stop gives the wait up."""
        try:
            with self.transport.lock:
                self.transport.send(f"{HOME}\n".encode("ascii"))
                return self.transport.receive(
                    until=END,
                    timeout_s=self.config.home_limit_s,
                    unless=lambda: self.is_stopped,
                )
        except DeviceTimeoutError:
            self.pause(0)  # a stop from another thread is told as such
            raise

    def _stands_at(self, place: Position) -> bool:
        seen = self._seen()
        if seen.state == "Run":
            return False
        is_there = all(
            abs(now - asked) <= NEAR_MM for now, asked in zip(seen.place_mm, place, strict=True)
        )
        if seen.state == "Idle" and is_there:
            return True
        self.pause(0)  # a stop from another thread is told as such
        raise DeviceError(
            f"the move ended in state {seen.state} at {seen.place_mm}",
            code="device.alarm",
            context={"state": seen.state},
        )

    def _where(self) -> dict[str, Any]:
        """Return where the tool stands.

        Raises:
            DeviceError: The controller is locked: what it tells of its place is not true.
        """
        seen = self._seen()
        if seen.state == "Alarm":
            raise DeviceError("the controller is locked, its position is lost", code="device.alarm")
        x, y, z = seen.place_mm
        return {"x_mm": x, "y_mm": y, "z_mm": z, "machine_state": seen.state}

    def _seen(self) -> GrblStatus:
        frame = self.transport.exchange(ASK, until=b">\r\n", timeout_s=ANSWER_S)
        return decode_report(frame[max(frame.rfind(b"<"), 0) :])

    def _ask(self, line: str) -> list[str]:
        frame = self.transport.exchange(f"{line}\n".encode("ascii"), until=END, timeout_s=ANSWER_S)
        return decode_answer(frame)
