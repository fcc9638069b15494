"""Cole-Parmer Masterflex L/S peristaltic pump, computer-linkable drive.

Protocol: RS-232, 4800 7O1, STX, `P` and number, command, CR; answers ACK or NAK.
Quality: bronze, simulated instrument.
Safe state: the pump stands; on a lost link a delivery ends by the drive's count, a flow goes on.

The published commands tell neither speed nor motion, so statuses are those of the last command
that the drive acknowledged. Before the first one nobody knows whether it runs: stop it once.

Source:
    Cole-Parmer, Masterflex L/S computer-compatible drives, section "Serial commands".
"""

from __future__ import annotations

import re
from contextlib import suppress
from typing import Annotated, ClassVar, Literal

import msgspec

from drivers.base import (
    DeviceStoppedError,
    Driver,
    Range,
    Report,
    action,
    after_acting,
    before_acting,
    status,
)
from drivers.connectors._flow import check_delivery, refuse_if_running
from drivers.connectors._motion import POLL_S, refuse_rate
from drivers.interfaces.continuous_pump import ContinuousPump
from drivers.transports.base import ByteTransport
from labweb.domain.errors import (
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)

STX, ENQ, ACK, NAK = b"\x02", b"\x05", b"\x06", b"\x15"
ANSWER = re.compile(rb"[\x06\x15]|\x02[^\r]*\r")
"""A whole answer: ACK, NAK, or data from STX to CR."""

ANSWER_S = 1.0
SLOWEST_RPM, LEAST_TURNS = 1.6, 0.01
"""Lowest speed of the drive, and the lowest argument of V."""

SETTLE_S = 0.5
"""What starting adds to the time of the turns."""

Rate = Annotated[float, Range(0.001, 100_000.0)]
Volume = Annotated[float, Range(0.001, 10_000_000.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One drive on its line."""

    per_turn_ul: Annotated[float, Range(0.01, 100_000.0)]
    """Volume of one turn of the head with the tube that is in it: calibrate it."""

    address_index: Annotated[int, Range(1, 89)] = 1
    """Number of the drive; a drive that was just switched on is given it."""

    direction: Literal["CW", "CCW"] = "CW"
    """Sense of rotation that moves liquid from inlet to outlet."""

    max_speed_rpm: Annotated[float, Range(1.6, 600.0)] = 600.0


def encode_command(address: int, command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_command(2, "S+100.0")
        b'\x02P02S+100.0\r'
    """
    return STX + f"P{address:02d}{command}\r".encode("ascii")  # table: two digits


def encode_claim(address: int) -> bytes:
    r"""Build the frame that gives the drive its number.

    Example:
        >>> encode_claim(2)
        b'\x05P02\r'
    """
    return ENQ + f"P{address:02d}\r".encode("ascii")  # table: two digits


class MasterflexLs(Driver[ByteTransport, Config], ContinuousPump):
    """One drive at one number of the line."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    _speed_rpm: float | None = None
    _is_running: bool | None = None

    def connect(self) -> None:
        """Open the line and make sure that a drive answers; whether it runs is open."""
        self._speed_rpm = self._is_running = None
        super().connect()

    def identify(self) -> None:
        """Ask who is there, and give the drive its number. Nothing moves."""
        with suppress(DeviceTimeoutError):  # a drive that has its number may keep silent
            self.transport.exchange(ENQ, until=ANSWER, timeout_s=ANSWER_S)
        self._exchange(encode_claim(self.config.address_index))

    def halt(self) -> None:
        """Halt the drive."""
        self._do("H")
        self._is_running = False

    @status(every_s=1.0)
    def rate_setpoint_ul_s(self) -> float | None:
        """Tell the rate of the speed that was last acknowledged; None: not known."""
        return None if self._speed_rpm is None else self._rate_ul_s(self._speed_rpm)

    @status(every_s=1.0)
    def is_running(self) -> bool | None:
        """Tell whether the last acknowledged command was to go; None: not known."""
        return self._is_running

    @action(timeout_s=30.0, recovery="R1", hazards=("expels_liquid",))
    def start_flow(self, rate_ul_s: Rate) -> Report:
        """Pump from inlet to outlet at a rate, and return while it goes on.

        Effect:
            Liquid moves until `stop_flow`; how much is the rate by the time.
        """
        self.refuse_if_stopped()
        speed_rpm = self._speed_of(rate_ul_s)
        self._set(speed_rpm)
        self._do("G0")
        self._is_running = True
        return Report(evidence={"speed_rpm": speed_rpm, "rate_ul_s": self._rate_ul_s(speed_rpm)})

    @action(timeout_s=30.0, recovery="R1")
    def stop_flow(self) -> Report:
        """Stop pumping.

        Effect:
            Nothing moves any more.
        """
        with after_acting():
            self.halt()
        return Report(evidence={"is_running": False})

    @action(timeout_s=1260.0, recovery="R3", hazards=("expels_liquid",), operation="transfer")
    def deliver(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Pump a volume from inlet to outlet, and return once the pump stands.

        Effect:
            `moved_ul` from the inlet to the outlet, by the drive's own count of turns.
        """
        self.refuse_if_stopped()
        speed_rpm = self._speed_of(rate_ul_s)
        turns = round(volume_ul / self.config.per_turn_ul, 2)
        duration_s = check_delivery(volume_ul, self._rate_ul_s(speed_rpm))
        if turns < LEAST_TURNS:
            raise PreconditionError(
                f"{volume_ul:g} µL is less than {LEAST_TURNS:g} turn of the drive",
                code="device.volume_too_small",
            )
        refuse_if_running(self.is_running)
        self._set(speed_rpm)
        with before_acting():
            self._do("Z")
            self._do(f"V{turns:.2f}")
        self._do("G")
        self._is_running = True
        started_s = self.now_s()
        with after_acting():
            self._await_turns(started_s, duration_s + SETTLE_S, speed_rpm)
            self.halt()
        moved_ul = round(turns * self.config.per_turn_ul, 3)
        return Report(
            moved_ul, {"speed_rpm": speed_rpm}, resolution_ul=self.config.per_turn_ul * LEAST_TURNS
        )

    def _await_turns(self, started_s: float, wait_s: float, speed_rpm: float) -> None:
        try:
            self.pause(0)
            while (left_s := started_s + wait_s - self.now_s()) > 0:
                self.pause(min(POLL_S, left_s))
        except DeviceStoppedError as error:
            ran_s = self.now_s() - started_s
            self.halt()
            error.effect = Effect.PARTIAL
            error.context["moved_ul"] = round(self._rate_ul_s(speed_rpm) * ran_s, 3)
            raise

    def _set(self, speed_rpm: float) -> None:
        with before_acting():
            sign = "+" if self.config.direction == "CW" else "-"
            self._do(f"S{sign}{speed_rpm:.1f}")
        self._speed_rpm = speed_rpm

    def _speed_of(self, rate_ul_s: float) -> float:
        slowest_ul_s = self._rate_ul_s(SLOWEST_RPM)
        refuse_rate(rate_ul_s, slowest_ul_s, self._rate_ul_s(self.config.max_speed_rpm))
        return round(rate_ul_s * 60 / self.config.per_turn_ul, 1)

    def _rate_ul_s(self, speed_rpm: float) -> float:
        return speed_rpm * self.config.per_turn_ul / 60

    def _do(self, command: str) -> None:
        self._exchange(encode_command(self.config.address_index, command))

    def _exchange(self, frame: bytes) -> None:
        answer = self.transport.exchange(frame, until=ANSWER, timeout_s=ANSWER_S)
        if answer.endswith(NAK):
            raise RejectedError(f"the drive does not take {frame!r} (NAK)")
        if not answer.endswith(ACK):
            raise FrameError(
                f"{frame!r} is answered by neither ACK nor NAK", context={"frame": answer.hex()}
            )
