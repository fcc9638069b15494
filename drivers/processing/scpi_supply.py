"""Supplies that speak SCPI: Keysight E3633A and ITECH IT6300.

Protocol: SCPI-1999, 9600 8N1 or TCP, text lines LF; setters are silent, queries answer a value.
Quality: bronze, simulated instrument.
Safe state: output off; on a lost link it goes on.

Both models know the same commands but for the register that tells whether the voltage or
the current is kept. Setters are silent: the error queue is read after them.

No accuracy is stated: supplies of several makers speak this, each with figures of its own.

Source:
    Agilent, E3633A and E3634A user's guide, chapter "Remote interface reference"; ITECH,
    IT6300 programming guide.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.power_supply import PowerSupply
from drivers.transports.base import ByteTransport
from drivers.waiting import once_started, refuse_beyond, refuse_untaken
from labweb.domain.errors import DeviceError, FrameError, RejectedError

END = b"\n"
NAMES = {"keysight_e3633a": "E3633A", "itech_it6300": "IT63"}
CONDITION = {"keysight_e3633a": "STAT:QUES:COND?", "itech_it6300": "STAT:OPER:COND?"}
CURRENT_KEPT = {"keysight_e3633a": 1, "itech_it6300": 1 << 5}  # tables of status registers
VOLTAGE_KEPT = {"keysight_e3633a": 2, "itech_it6300": 1 << 4}  # tables of status registers
MA_PER_A = 1000.0
RESOLUTION_V, RESOLUTION_MA = 0.002, 2.0
ANSWER_S = 1.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One supply."""

    model: Literal["keysight_e3633a", "itech_it6300"]
    max_voltage_v: Annotated[float, Range(0.0, 60.0)]
    """Highest voltage that this lab allows."""

    max_current_ma: Annotated[float, Range(0.0, 20_600.0)]
    """Highest current that this lab allows."""

    settle_s: Annotated[float, Range(0.0, 30.0)] = 0.5
    """Time between turning on and measuring."""


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("VOLT 1.82")
        b'VOLT 1.82\n'
    """
    return f"{command}\n".encode("ascii")


def decode_text(frame: bytes) -> str:
    r"""Read an answer as text; models end it with LF or CR LF.

    Raises:
        FrameError: Not printable.

    Example:
        >>> decode_text(b'+0,"No error"\r\n')
        '+0,"No error"'
    """
    if not re.fullmatch(rb"[\x20-\x7e]+\r?\n", frame):
        raise FrameError("answer is no text", context={"frame": frame.hex()})
    return frame.decode("ascii").strip()


def decode_number(frame: bytes) -> float:
    r"""Read an answer as a number.

    Raises:
        FrameError: Not a number.

    Example:
        >>> decode_number(b"+1.82000000E+00\r\n")
        1.82
    """
    text = decode_text(frame)
    if not re.fullmatch(r"[+-]?[0-9]{1,9}(\.[0-9]{1,12})?([Ee][+-]?[0-9]{1,2})?", text):
        raise FrameError(f"answer is {text!r}, no number", context={"frame": frame.hex()})
    return float(text)


class ScpiSupply(Driver[ByteTransport, Config], PowerSupply):
    """One supply."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the name, and refuse another model; then take control from the panel."""
        name = decode_text(self._exchange("*IDN?"))
        if NAMES[self.config.model] not in name:
            raise RejectedError(
                f"{self.transport.line} answers as {name!r}, expected {NAMES[self.config.model]!r}",
                context={"model": name},
            )
        self._send("SYST:REM")
        self._send("*CLS")

    def halt(self) -> None:
        """Turn the output off."""
        self._send("OUTP OFF")
        if self._number("OUTP?") != 0:
            raise DeviceError("the output is still on")

    @status(every_s=1.0)
    def voltage_v(self) -> float:
        """Tell the voltage at the terminals."""
        return self._number("MEAS:VOLT?")

    @status(every_s=1.0)
    def current_ma(self) -> float:
        """Tell the current that flows."""
        return round(self._number("MEAS:CURR?") * MA_PER_A, 6)

    @status(every_s=2.0)
    def voltage_setpoint_v(self) -> float:
        """Tell the wanted voltage."""
        return self._number("VOLT?")

    @status(every_s=2.0)
    def current_setpoint_ma(self) -> float:
        """Tell the limit of current."""
        return round(self._number("CURR?") * MA_PER_A, 6)

    @action(timeout_s=60.0, recovery="R1", hazards=("electricity",))
    def supply(
        self,
        voltage_v: Annotated[float, Range(0.0, 60.0)],
        current_ma: Annotated[float, Range(0.0, 20_600.0)],
    ) -> Report:
        """Turn the output on with a voltage and a limit of current, and measure both.

        Raises:
            DeviceError: A setpoint was not taken, a fault, or stopped: the output is off
                again (PARTIAL).

        Effect:
            The output stays on with these setpoints.
        """
        self.refuse_if_stopped()
        refuse_beyond("voltage", voltage_v, 0.0, self.config.max_voltage_v)
        refuse_beyond("current", current_ma, 0.0, self.config.max_current_ma)
        with before_acting():
            self.voltage_v()
            self._send("*CLS")
        with once_started(self.halt, self._evidence, driver=self):
            self._send(f"VOLT {voltage_v:.4f}")
            self._send(f"CURR {current_ma / MA_PER_A:.5f}")
            self._refuse_error()
            taken_v, taken_ma = self.voltage_setpoint_v(), self.current_setpoint_ma()
            refuse_untaken("voltage", taken_v, voltage_v, resolution=RESOLUTION_V)
            refuse_untaken("current", taken_ma, current_ma, resolution=RESOLUTION_MA)
            self._send("OUTP ON")
            self._refuse_error()
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
            DeviceError: Neither: the output is off, or tripped.
        """
        condition = int(self._number(CONDITION[self.config.model]))
        model = self.config.model
        is_current = condition & CURRENT_KEPT[model]
        is_voltage = condition & VOLTAGE_KEPT[model]
        if bool(is_current) == bool(is_voltage):
            raise DeviceError(
                f"output keeps neither voltage nor current: condition {condition}",
                code="device.alarm",
                context={"alarm": condition},
            )
        return "current" if is_current else "voltage"

    def _refuse_error(self) -> None:
        error = decode_text(self._exchange("SYST:ERR?"))
        match = re.match(r"([+-]?[0-9]{1,5}),", error)
        if match is None:
            raise FrameError(f"answer to SYST:ERR? is {error!r}")
        if int(match[1]) != 0:
            raise RejectedError(f"supply reports {error}", context={"error": error})

    def _evidence(self) -> dict[str, Any]:
        return {
            "voltage_v": self.voltage_v(),
            "current_ma": self.current_ma(),
            "is_on": self._number("OUTP?") != 0,
        }

    def _number(self, query: str) -> float:
        return decode_number(self._exchange(query))

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)

    def _send(self, command: str) -> None:
        self.transport.send(encode_line(command))
