"""Aim-TTi PL-P laboratory supply, first output.

Protocol: TTi text lines, 9600 8N1 or TCP, LF in and CR LF out; setters silent, queries a value.
Quality: bronze, simulated instrument.
Safe state: output off; on a lost link it goes on.

Source:
    Aim-TTi, PL-P series instruction manual, section "Remote commands".
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.power_supply import PowerSupply
from drivers.transports.base import ByteTransport
from drivers.waiting import once_started, refuse_between_steps, refuse_beyond, refuse_untaken
from labweb.domain.errors import DeviceError, FrameError, RejectedError

END = b"\r\n"
MODEL = re.compile(r"THURLBY[ -]THANDAR, *PL[0-9]", re.IGNORECASE)
STEP_V, STEP_MA = 0.001, 0.1
MA_PER_A = 1000.0
VOLTAGE_KEPT, CURRENT_KEPT = 1, 2
TRIPS = {4: "voltage trip", 8: "current trip", 64: "hard trip"}  # section "Limit status"
ANSWER_S = 1.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One output."""

    max_voltage_v: Annotated[float, Range(0.0, 60.0)]
    """Highest voltage that this lab allows."""

    max_current_ma: Annotated[float, Range(0.0, 50_000.0)]
    """Highest current that this lab allows."""

    settle_s: Annotated[float, Range(0.0, 30.0)] = 0.5
    """Time between turning on and measuring."""


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("V1 1.82")
        b'V1 1.82\n'
    """
    return f"{command}\n".encode("ascii")


def decode_number(frame: bytes, before: str, after: str) -> float:
    r"""Read the number between what comes before and after it.

    Raises:
        FrameError: Not such an answer.

    Example:
        >>> decode_number(b"1.8200V\r\n", "", "V")
        1.82
    """
    form = rf"{before}(-?[0-9]{{1,5}}(?:\.[0-9]{{1,6}})?){after}\r\n".encode("ascii")
    match = re.fullmatch(form, frame)
    if match is None:
        raise FrameError("answer is no number of this kind", context={"frame": frame.hex()})
    return float(match[1])


class TtiPl(Driver[ByteTransport, Config], PowerSupply):
    """One output of a supply."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the name, and refuse another series."""
        name = self._exchange("*IDN?").decode("ascii", errors="replace").strip()
        if not MODEL.match(name):
            raise RejectedError(
                f"{self.transport.line} answers as {name!r}, expected a PL supply of Aim-TTi",
                context={"model": name},
            )

    def halt(self) -> None:
        """Turn the output off."""
        self._send("OP1 0")
        if self._is_on():
            raise DeviceError("the output is still on")

    @status(every_s=1.0)
    def voltage_v(self) -> float:
        """Tell the voltage at the terminals."""
        return decode_number(self._exchange("V1O?"), "", "V")

    @status(every_s=1.0)
    def current_ma(self) -> float:
        """Tell the current that flows."""
        return round(decode_number(self._exchange("I1O?"), "", "A") * MA_PER_A, 6)

    @status(every_s=2.0)
    def voltage_setpoint_v(self) -> float:
        """Tell the wanted voltage."""
        return decode_number(self._exchange("V1?"), "V1 ", "")

    @status(every_s=2.0)
    def current_setpoint_ma(self) -> float:
        """Tell the limit of current."""
        return round(decode_number(self._exchange("I1?"), "I1 ", "") * MA_PER_A, 6)

    @action(timeout_s=60.0, recovery="R1", hazards=("electricity",))
    def supply(
        self,
        voltage_v: Annotated[float, Range(0.0, 60.0)],
        current_ma: Annotated[float, Range(0.0, 50_000.0)],
    ) -> Report:
        """Turn the output on with a voltage and a limit of current, and measure both.

        Raises:
            PreconditionError: Beyond the limits of this lab, or between two steps (NONE).
            DeviceError: A setpoint was not taken, a trip, or stopped: the output is off
                again (PARTIAL).

        Effect:
            The output stays on with these setpoints.
        """
        self.refuse_if_stopped()
        refuse_beyond("voltage", voltage_v, 0.0, self.config.max_voltage_v)
        refuse_beyond("current", current_ma, 0.0, self.config.max_current_ma)
        refuse_between_steps("voltage", voltage_v, STEP_V)
        refuse_between_steps("current", current_ma, STEP_MA)
        with before_acting():
            self._limit_events()  # reading them clears what an earlier run left
        with once_started(self.halt, self._evidence, driver=self):
            self._send(f"V1 {voltage_v:.3f}")
            self._send(f"I1 {current_ma / MA_PER_A:.4f}")
            taken_v, taken_ma = self.voltage_setpoint_v(), self.current_setpoint_ma()
            refuse_untaken("voltage", taken_v, voltage_v, resolution=STEP_V)
            refuse_untaken("current", taken_ma, current_ma, resolution=STEP_MA)
            self._send("OP1 1")
            self.pause(self.config.settle_s)
            return Report(evidence={**self._evidence(), "keeps": self._kept()})

    @action(timeout_s=30.0, recovery="R1")
    def stop_supply(self) -> Report:
        """Turn the output off.

        Effect:
            No current flows.
        """
        with once_started(self.halt, self._evidence, driver=self):
            self.halt()
            return Report(evidence=self._evidence())

    def _kept(self) -> str:
        """Tell whether the voltage or the current is kept.

        Raises:
            DeviceError: The output tripped, or is off.
        """
        events = self._limit_events()
        trips = [name for bit, name in TRIPS.items() if events & bit]
        if trips or not self._is_on():
            raise DeviceError(
                f"output is off: {', '.join(trips) or 'it did not turn on'}",
                code="device.alarm",
                context={"alarm": trips},
            )
        return "current" if events & CURRENT_KEPT else "voltage"

    def _limit_events(self) -> int:
        return int(decode_number(self._exchange("LSR1?"), "", ""))

    def _is_on(self) -> bool:
        return decode_number(self._exchange("OP1?"), "", "") != 0

    def _evidence(self) -> dict[str, Any]:
        return {
            "voltage_v": self.voltage_v(),
            "current_ma": self.current_ma(),
            "is_on": self._is_on(),
        }

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)

    def _send(self, command: str) -> None:
        self.transport.send(encode_line(command))
