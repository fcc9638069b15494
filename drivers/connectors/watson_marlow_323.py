"""Watson-Marlow 323Du peristaltic pump.

Protocol: RS-232, 9600 8N2 (`format=8N2` in its address), pump number, command, CR, which the pump
echoes; RS answers model, speed, direction, running flag and `!` behind its echo.
Quality: bronze, simulated instrument.
Safe state: the pump stands; on a lost link it goes on, no watchdog is known.

Setters have no answer but their echo, so each is proved by the answer to RS that follows it. An
echo that does not come, or comes otherwise, is a command that the pump may have read otherwise.

The pump is told whole rpm, up to three figures. A rate between two of them is refused with both;
none is rounded. No accuracy of a flow is stated: tube and head make a flow of the speed.

Source:
    Watson-Marlow, 323E, 323S, 323U and 323Du user manual, p. 27, "RS232 settings" (2 stop bits,
    echo on) and "RS232 command modes" (`1SPxxx`, `323Du 110 CW 1 !`, 10 ms between commands).
"""

from __future__ import annotations

import math
import re
from typing import Annotated, ClassVar, Literal, NamedTuple

import msgspec

from drivers.base import Driver, Range, Report, action, after_acting, before_acting, status
from drivers.connectors._flow import check_delivery, deliver, refuse_if_running
from drivers.connectors._motion import refuse_rate
from drivers.interfaces.continuous_pump import ContinuousPump
from drivers.transports.base import ByteTransport
from labweb.domain.errors import (
    DeviceError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)

MODEL = "323Du"
END = b"!"
ANSWER_S = 1.0
GAP_S = 0.01
"""Least time between two commands."""

SLOWEST_RPM = 3

AS_WRITTEN_RATIO = 1e-5
"""How far a rate may lie beside a whole speed: six figures, as it is told, go no nearer."""

Rate = Annotated[float, Range(0.001, 100_000.0)]
Volume = Annotated[float, Range(0.001, 10_000_000.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One pump on its line."""

    per_turn_ul: Annotated[float, Range(0.01, 100_000.0)]
    """Volume of one turn of the head with the tube that is in it: calibrate it."""

    address_index: Annotated[int, Range(1, 16)] = 1
    """Pump number."""

    direction: Literal["CW", "CCW"] = "CW"
    """Sense of rotation that moves liquid from inlet to outlet."""

    max_speed_rpm: Annotated[int, Range(3, 400)] = 400


class WatsonMarlowStatus(NamedTuple):
    """What RS tells."""

    model: str
    speed_rpm: float
    direction: str
    is_running: bool


def encode_command(address: int, command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_command(1, "SP50")
        b'1SP50\r'
    """
    return f"{address}{command}\r".encode("ascii")


def decode_status(frame: bytes) -> WatsonMarlowStatus:
    """Read the answer to RS.

    Raises:
        FrameError: Not such an answer.

    Example:
        >>> decode_status(b"323Du 110 CW 1 !")
        Told(model='323Du', speed_rpm=110.0, direction='CW', is_running=True)
    """
    match = re.fullmatch(rb"\s*(\w+) +(\d{1,4}(?:\.\d+)?) +(CW|CCW) +([01]) +!", frame)
    if match is None:
        raise FrameError("answer is no status of the pump", context={"frame": frame.hex()})
    model, speed, direction, running = (part.decode("ascii") for part in match.groups())
    return WatsonMarlowStatus(model, float(speed), direction, running == "1")


def decode_echo(answer: bytes, frame: bytes) -> bytes:
    r"""Return what follows the echo of a command.

    Raises:
        FrameError: Another echo, or none: the pump may have read another command.

    Example:
        >>> decode_echo(b"1RS\r323Du 110 CW 1 !", b"1RS\r")
        b'323Du 110 CW 1 !'
    """
    if not answer.startswith(frame):
        raise FrameError(
            "the pump does not echo what it was sent: its echo has to be on",
            context={"sent": frame.hex(), "frame": answer.hex()},
        )
    return answer.removeprefix(frame)


class WatsonMarlow323(Driver[ByteTransport, Config], ContinuousPump):
    """One pump at one number of the line."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the status, and refuse another model. Nothing moves."""
        if (model := self._status().model) != MODEL:
            raise RejectedError(f"{self.transport.line} answers as {model!r}, expected {MODEL!r}")

    def halt(self) -> None:
        """Stop the pump, and make sure that it stands."""
        self._send("ST")
        if self._status().is_running:
            raise DeviceError("the pump was told to stop, and runs", effect=Effect.UNKNOWN)

    @status(every_s=1.0)
    def rate_setpoint_ul_s(self) -> float:
        """Tell the rate of the speed that is set."""
        return self._rate_ul_s(self._status().speed_rpm)

    @status(every_s=1.0)
    def is_running(self) -> bool:
        """Tell whether the pump runs."""
        return self._status().is_running

    @action(timeout_s=30.0, recovery="R1", hazards=("expels_liquid",))
    def start_flow(self, rate_ul_s: Rate) -> Report:
        """Pump from inlet to outlet at a rate, and return while it goes on.

        Effect:
            Liquid moves until `stop_flow`; how much is the rate by the time.
        """
        self.refuse_if_stopped()
        speed_rpm = self._speed_rpm(rate_ul_s)
        self._set(speed_rpm)
        self._start()
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
            `moved_ul` from the inlet to the outlet, by rate and time.
        """
        self.refuse_if_stopped()
        speed_rpm = self._speed_rpm(rate_ul_s)
        actual_ul_s = self._rate_ul_s(speed_rpm)
        check_delivery(volume_ul, actual_ul_s)
        refuse_if_running(self.is_running)
        self._set(speed_rpm)
        return deliver(
            self,
            volume_ul=volume_ul,
            rate_ul_s=actual_ul_s,
            begin=self._start,
            end=self.halt,
            is_running=self.is_running,
        )

    def _set(self, speed_rpm: int) -> None:
        """Set speed and direction, and prove both."""
        with before_acting():
            self._send(f"SP{speed_rpm}")
            self._send("RR" if self.config.direction == "CW" else "RL")
            told = self._status()
            if told.speed_rpm != speed_rpm or told.direction != self.config.direction:
                raise RejectedError(
                    f"the pump holds {told.speed_rpm:g} rpm {told.direction}, "
                    f"not {speed_rpm} rpm {self.config.direction}"
                )

    def _start(self) -> None:
        self._send("GO")
        with after_acting():
            if not self._status().is_running:
                self.pause(0)  # a stop stands the pump still before anybody else hears of it
                raise DeviceError("the pump was told to run, and stands", effect=Effect.UNKNOWN)

    def _speed_rpm(self, rate_ul_s: float) -> int:
        asked_rpm = rate_ul_s * 60 / self.config.per_turn_ul
        speed_rpm = round(asked_rpm)
        is_whole = abs(asked_rpm - speed_rpm) <= AS_WRITTEN_RATIO * asked_rpm
        refuse_rate(
            self._rate_ul_s(speed_rpm) if is_whole else rate_ul_s,
            self._rate_ul_s(SLOWEST_RPM),
            self._rate_ul_s(self.config.max_speed_rpm),
        )
        if is_whole:
            return speed_rpm
        below, above = math.floor(asked_rpm), math.ceil(asked_rpm)
        raise PreconditionError(
            f"{rate_ul_s:g} µL/s is {asked_rpm:.6g} rpm, and the pump takes whole rpm: ask for "
            f"{self._rate_ul_s(below):.6g} µL/s ({below} rpm) or "
            f"{self._rate_ul_s(above):.6g} µL/s ({above} rpm)",
            code="device.resolution",
        )

    def _rate_ul_s(self, speed_rpm: float) -> float:
        return speed_rpm * self.config.per_turn_ul / 60

    def _status(self) -> WatsonMarlowStatus:
        frame = encode_command(self.config.address_index, "RS")
        answer = self.transport.exchange(frame, until=END, timeout_s=ANSWER_S, gap_s=GAP_S)
        return decode_status(decode_echo(answer, frame))

    def _send(self, command: str) -> None:
        frame = encode_command(self.config.address_index, command)
        echo = self.transport.exchange(frame, until=frame[-1:], timeout_s=ANSWER_S, gap_s=GAP_S)
        decode_echo(echo, frame)
