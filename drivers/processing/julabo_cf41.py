"""Julabo CF41 cryo-compact circulator.

Protocol: Julabo lines, 9600 7E1 with RTS/CTS, CR LF, 0.3 s apart; setters silent, queries a value.
Quality: bronze, simulated instrument.
Safe state: control, pump and compressor off; on a lost link the bath goes on.

Setters have no answer, so what was set is read back. The status line tells the fault that is
there, and why the last setter was refused.

Source:
    Julabo, operating manual of CF41, section "Interface commands" and table of messages. Its
    range up to 200 °C, and up to 110 °C with the fluid H5: published graphs of Chemputers, and
    PyLabware.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from drivers.base import Accuracy, Driver, Quantity, Range, Report, action, before_acting, status
from drivers.interfaces.thermostat import Thermostat
from drivers.transports.base import ByteTransport
from drivers.waiting import (
    TemperatureControl,
    once_started,
    refuse_beyond,
    refuse_untaken,
)
from labweb.domain.errors import DeviceError, FrameError, RejectedError

END = b"\r\n"
MODEL = "JULABO CRYOCOMPACT CF41"
REMOTE = {"02", "03"}
MANUAL = {"00", "01"}
REFUSALS = {
    "-08": "invalid command",
    "-09": "not allowed in this mode",
    "-10": "value too small",
    "-11": "value too large",
}
"""Why the last setter was not taken; nothing is wrong with the bath."""

WARNINGS = {"-20", "-40"}
"""Condenser dirty, level low: the bath goes on, and so does the action."""

ANSWER_S = 1.0

Temperature = Annotated[float, Range(-40.0, 200.0), Accuracy()]
Tolerance = Annotated[float, Range(0.01, 50.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One circulator."""

    sensor: Literal["internal", "external"] = "internal"
    """Reading that is controlled: the bath's, or that of the external Pt100."""

    min_temperature_c: Temperature = -40.0
    max_temperature_c: Temperature = 110.0
    """Highest temperature of the bath fluid: the one that most of these baths hold ends at 110 °C,
    the circulator itself at 200 °C."""

    reach_limit_s: Annotated[float, Range(0.1, 42_000.0)] = 14_000.0
    """Longest time to reach a temperature."""

    settle_s: Annotated[float, Range(0.0, 600.0)] = 5.0
    """How long the reading must stay within tolerance."""

    grace_s: Annotated[float, Range(0.0, 600.0)] = 30.0
    """How long a held temperature may leave its tolerance."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 1.0
    gap_s: Annotated[float, Range(0.0, 5.0)] = 0.3
    """Least time between two commands."""


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("OUT_SP_00 60.00")
        b'OUT_SP_00 60.00\r\n'
    """
    return f"{command}\r\n".encode("ascii")


def decode_text(frame: bytes) -> str:
    r"""Read an answer as text.

    Raises:
        FrameError: Not printable.

    Example:
        >>> decode_text(b"03 REMOTE START\r\n")
        '03 REMOTE START'
    """
    if not re.fullmatch(rb"[\x20-\x7e]*\r\n", frame):
        raise FrameError("answer is no text", context={"frame": frame.hex()})
    return frame.decode("ascii").strip()


def decode_number(frame: bytes) -> float:
    r"""Read an answer as a number.

    Raises:
        FrameError: Not a number.

    Example:
        >>> decode_number(b" -12.34\r\n")
        -12.34
    """
    text = decode_text(frame)
    if not re.fullmatch(r"[+-]?[0-9]{1,5}(\.[0-9]{1,4})?", text):
        raise FrameError(f"answer is {text!r}, no number", context={"frame": frame.hex()})
    return float(text)


class JulaboCf41(Driver[ByteTransport, Config], Thermostat):
    """One circulator."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the version, and refuse another model."""
        name = decode_text(self._exchange("VERSION"))
        if not name.startswith(MODEL):
            raise RejectedError(
                f"{self.transport.line} answers as {name!r}, expected {MODEL!r}",
                context={"model": name},
            )

    def halt(self) -> None:
        """Turn the circulator off."""
        self._send("OUT_MODE_05 0")

    @status(every_s=2.0)
    def temperature_c(self) -> Annotated[float, Accuracy()]:
        """Tell the reading that is controlled."""
        return self._number("IN_PV_00" if self.config.sensor == "internal" else "IN_PV_02")

    @status(every_s=2.0)
    def bath_temperature_c(self) -> float:
        """Tell the reading of the circulator's own bath."""
        return self._number("IN_PV_00")

    @status(every_s=4.0)
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature."""
        return self._number("IN_SP_00")

    @status(every_s=4.0)
    def is_controlling(self) -> bool:
        """Tell whether temperature control is on."""
        return self._number("IN_MODE_05") == 1

    @action(timeout_s=43_200.0, recovery="R1", hazards=("heat", "cold"))
    def reach_temperature(self, temperature_c: Temperature, tolerance_c: Tolerance) -> Report:
        """Heat or cool, and return once the reading has stayed within tolerance.

        Raises:
            DeviceError: Not reached in time, a fault, or stopped: control is off again, and
                `context["temperature_c"]` says how far it came (PARTIAL).

        Effect:
            Temperature control and circulation stay on with this setpoint.
        """
        self._check_start(temperature_c)
        return self._control.reach(temperature_c, tolerance_c)

    @action(timeout_s=604_800.0, recovery="R3", hazards=("heat", "cold"))
    def hold(
        self,
        duration_s: Annotated[float, Range(0.0, 600_000.0)],
        temperature_c: Temperature,
        tolerance_c: Tolerance,
    ) -> Report:
        """Keep a temperature that is already reached for a while, and watch it.

        After a crash nobody can tell how long it was kept: a person decides.

        Raises:
            PreconditionError: The reading is not within tolerance at the start (NONE).
            DeviceError: It left the tolerance for longer than the grace time, a fault, or
                stopped: control is off, and `context["held_s"]` says after how long (PARTIAL).

        Effect:
            Temperature control and circulation stay on with this setpoint.
        """
        reading_c = self._check_start(temperature_c)
        return self._control.hold(reading_c, duration_s, temperature_c, tolerance_c)

    @action(timeout_s=30.0, recovery="R1")
    def stop_control(self) -> Report:
        """Turn temperature control and circulation off; the bath drifts to the room's.

        Effect:
            Heater, compressor and pump are off.
        """
        with once_started(self.halt, self._temperatures, driver=self):
            self.halt()
            if self.is_controlling():
                raise RejectedError("the circulator did not turn off: is it set to remote?")
            return Report(evidence=self._temperatures())

    @property
    def _control(self) -> TemperatureControl:
        return TemperatureControl(
            driver=self,
            read=self._reading_under_control,
            begin=self._start,
            end=self.halt,
            describe=self._temperatures,
        )

    def _check_start(self, temperature_c: float) -> float:
        """Return the reading before anything is sent that acts."""
        self.refuse_if_stopped()
        low_c, high_c = self.config.min_temperature_c, self.config.max_temperature_c
        refuse_beyond("temperature", temperature_c, low_c, high_c)
        with before_acting():
            if (state := self._state()) in MANUAL:
                raise RejectedError(
                    "the circulator is driven by hand: set it to remote at its panel",
                    context={"state": state},
                )
            if (chosen := self._number("IN_MODE_01")) != 0:
                raise RejectedError(
                    f"setpoint {chosen + 1:g} is chosen, this driver sets the first",
                    context={"mode": chosen},
                )
            return self.temperature_c()

    def _start(self, temperature_c: float) -> None:
        self._set("MODE_04", int(self.config.sensor == "external"), 0.0)
        self._set("SP_00", round(temperature_c, 2), 0.01)
        self._send("OUT_MODE_05 1")

    def _reading_under_control(self) -> float:
        self._state()
        if not self.is_controlling():
            self.pause(0)  # a stop from another thread is told as such
            raise DeviceError("the circulator went off by itself", code="device.alarm")
        return self.temperature_c()

    def _state(self) -> str:
        """Return the code of the status line.

        Raises:
            DeviceError: The circulator reports a fault.
        """
        line = decode_text(self._exchange("STATUS"))
        code = line[:3] if line.startswith("-") else line[:2]
        if code in REFUSALS:
            raise RejectedError(f"circulator: {REFUSALS[code]}", context={"answer": line})
        if code.startswith("-") and code not in WARNINGS:
            raise DeviceError(
                f"circulator reports {line}", code="device.alarm", context={"alarm": line}
            )
        if code not in MANUAL | REMOTE | WARNINGS:
            raise FrameError(f"answer to STATUS is {line!r}")
        return code

    def _temperatures(self) -> dict[str, Any]:
        return {
            "temperature_c": self.temperature_c(),
            "temperature_setpoint_c": self.temperature_setpoint_c(),
        }

    def _set(self, name: str, value: float, resolution: float) -> None:
        self._send(f"OUT_{name} {value:g}")
        refuse_untaken(name, self._number(f"IN_{name}"), value, resolution=resolution)

    def _number(self, command: str) -> float:
        return decode_number(self._exchange(command))

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(
            encode_line(command), until=END, timeout_s=ANSWER_S, gap_s=self.config.gap_s
        )

    def _send(self, command: str) -> None:
        self.transport.send(encode_line(command), gap_s=self.config.gap_s)
