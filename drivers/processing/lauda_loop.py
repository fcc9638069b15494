"""LAUDA LOOP 100 and 250 thermoelectric circulation thermostat.

Protocol: LAUDA lines over RS 232, CR LF both ways; a setter is answered by OK, a refusal by ERR_X.
Quality: bronze, simulated instrument.
Safe state: standby, pump and Peltier elements off; on a lost link the thermostat goes on.

The thermostat has one sensor, in its outflow: the reading that is controlled is that of the bath.
A command has to wait for the answer to the one before. The rate of the line is set at the device.

Source:
    LAUDA, LOOP 100 / LOOP 250 operation manual V3, section 5.11.3 "Write commands",
    5.11.4 "Read commands", 5.11.5 "Error messages"; range 4 to 80 °C and zeros in front of a
    number as open drivers of the LOOP 250 have them (turbocasino, LOOP-L250-Chiller).
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar

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
MODEL = "BC_LOOP"
SOUND, FAULTY = 0, -1
"""Answers to STATUS, section 5.11.4."""

ON, STANDBY = 0, 1
"""Answers to IN_MODE_02, section 5.11.4."""

STEP_C = 0.01
ERRORS = {
    "ERR_2": "wrong entry",
    "ERR_3": "wrong command",
    "ERR_5": "syntax error in the value",
    "ERR_6": "value not allowed",
}
"""ERR_2 and ERR_3: section 5.11.5; ERR_5 and ERR_6 as the maker's table for the Microcool MC 250
has them, section 6.7.5. Any other is told as it came."""

ANSWER_S = 1.0

Temperature = Annotated[float, Range(4.0, 80.0), Accuracy()]
Tolerance = Annotated[float, Range(0.01, 20.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One thermostat."""

    min_temperature_c: Temperature = 4.0
    """Lowest temperature that this lab allows."""

    max_temperature_c: Temperature = 80.0
    """Highest temperature that this lab allows."""

    reach_limit_s: Annotated[float, Range(0.1, 42_000.0)] = 14_000.0
    """Longest time to reach a temperature."""

    settle_s: Annotated[float, Range(0.0, 600.0)] = 5.0
    """How long the reading must stay within tolerance."""

    grace_s: Annotated[float, Range(0.0, 600.0)] = 30.0
    """How long a held temperature may leave its tolerance."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 1.0


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("OUT_SP_00_30.50")
        b'OUT_SP_00_30.50\r\n'
    """
    return f"{command}\r\n".encode("ascii")


def decode_text(frame: bytes) -> str:
    r"""Read an answer as text.

    Raises:
        FrameError: Empty or not printable.
        RejectedError: The thermostat refuses the command.

    Example:
        >>> decode_text(b"BC_LOOP\r\n")
        'BC_LOOP'
    """
    if not re.fullmatch(rb"[\x20-\x7e]+\r\n", frame):
        raise FrameError("answer is no text", context={"frame": frame.hex()})
    text = frame.decode("ascii").strip()
    if text.startswith("ERR_"):
        why = ERRORS.get(text, "an error that its manual does not explain")
        raise RejectedError(f"the thermostat answers {text}: {why}", context={"answer": text})
    return text


def decode_number(frame: bytes) -> float:
    r"""Read an answer in fixed point: up to three digits, a point, two digits.

    Raises:
        FrameError: Not such a number.
        RejectedError: The thermostat refuses the command.

    Example:
        >>> decode_number(b"22.50\r\n"), decode_number(b"-004.10\r\n")
        (22.5, -4.1)
    """
    text = decode_text(frame)
    if not re.fullmatch(r"-?[0-9]{1,3}\.[0-9]{2}", text):
        raise FrameError(f"answer is {text!r}, no number", context={"frame": frame.hex()})
    return float(text)


def decode_whole(frame: bytes) -> int:
    r"""Read an answer that is a whole number, written alone or in fixed point.

    Raises:
        FrameError: Not such a number.
        RejectedError: The thermostat refuses the command.

    Example:
        >>> decode_whole(b"-1\r\n"), decode_whole(b"001.00\r\n")
        (-1, 1)
    """
    text = decode_text(frame)
    match = re.fullmatch(r"(-?[0-9]{1,3})(?:\.00)?", text)
    if match is None:
        raise FrameError(f"answer is {text!r}, no whole number", context={"frame": frame.hex()})
    return int(match[1])


class LaudaLoop(Driver[ByteTransport, Config], Thermostat):
    """One thermostat."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the type, and refuse another one."""
        name = self._text("TYPE")
        if name != MODEL:
            raise RejectedError(
                f"{self.transport.line} answers as {name!r}, expected {MODEL!r}",
                context={"model": name},
            )

    def halt(self) -> None:
        """Go to standby: pump and Peltier elements off."""
        self._order("STOP")

    @status(every_s=2.0)
    def temperature_c(self) -> Annotated[float, Accuracy()]:
        """Tell the reading that is controlled, which is that of the outflow."""
        return self._number("IN_PV_00")

    @status(every_s=2.0)
    def bath_temperature_c(self) -> float:
        """Tell the reading of the outflow."""
        return self._number("IN_PV_00")

    @status(every_s=4.0)
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature."""
        return self._number("IN_SP_00")

    @status(every_s=4.0)
    def is_controlling(self) -> bool:
        """Tell whether temperature control is on."""
        return self._one_of("IN_MODE_02", ON, STANDBY) == ON

    @action(timeout_s=43_200.0, recovery="R1", hazards=("heat", "cold"))
    def reach_temperature(self, temperature_c: Temperature, tolerance_c: Tolerance) -> Report:
        """Heat or cool, and return once the reading has stayed within tolerance.

        Raises:
            PreconditionError: Beyond the limits of this lab (NONE).
            DeviceError: Not reached in time, a fault, or stopped: it is in standby again, and
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
            PreconditionError: Beyond the limits of this lab, or the reading is not within
                tolerance at the start (NONE).
            DeviceError: It left the tolerance for longer than the grace time, a fault, or
                stopped: it is in standby, and `context["held_s"]` says after how long (PARTIAL).

        Effect:
            Temperature control and circulation stay on with this setpoint.
        """
        reading_c = self._check_start(temperature_c)
        return self._control.hold(reading_c, duration_s, temperature_c, tolerance_c)

    @action(timeout_s=30.0, recovery="R1")
    def stop_control(self) -> Report:
        """Turn temperature control and circulation off; the bath drifts to the room's.

        Effect:
            Pump and Peltier elements are off.
        """
        with once_started(self.halt, self._temperatures, driver=self):
            self.halt()
            if self.is_controlling():
                raise RejectedError("the thermostat did not go to standby")
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
            self._refuse_fault()
            return self.temperature_c()

    def _start(self, temperature_c: float) -> None:
        self._order(f"OUT_SP_00_{temperature_c:.2f}")
        taken_c = self.temperature_setpoint_c()
        refuse_untaken("temperature", taken_c, round(temperature_c, 2), resolution=STEP_C / 2)
        self._order("START")

    def _reading_under_control(self) -> float:
        self._refuse_fault()
        if not self.is_controlling():
            self.pause(0)  # a stop from another thread is told as such
            raise DeviceError("the thermostat went off by itself", code="device.alarm")
        return self.temperature_c()

    def _refuse_fault(self) -> None:
        if self._one_of("STATUS", SOUND, FAULTY) == FAULTY:
            diagnosis = self._text("STAT")
            raise DeviceError(
                f"the thermostat reports a fault, diagnosis {diagnosis}: see its display",
                code="device.alarm",
                context={"alarm": diagnosis},
            )

    def _temperatures(self) -> dict[str, Any]:
        return {
            "temperature_c": self.temperature_c(),
            "temperature_setpoint_c": self.temperature_setpoint_c(),
        }

    def _order(self, command: str) -> None:
        if (answer := self._text(command)) != "OK":
            raise FrameError(f"answer to {command} is {answer!r}")

    def _one_of(self, command: str, *known: int) -> int:
        answer = decode_whole(self._exchange(command))
        if answer not in known:
            raise FrameError(f"answer to {command} is {answer}, none of {known}")
        return answer

    def _text(self, command: str) -> str:
        return decode_text(self._exchange(command))

    def _number(self, command: str) -> float:
        return decode_number(self._exchange(command))

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)
