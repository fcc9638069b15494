"""Huber thermostats with the PB command set: Petite Fleur and others with Pilot ONE.

Protocol: PB, 9600 8N1 or TCP, `{M` address value CR LF in hexadecimal; answered by `{S` alike.
Quality: bronze, simulated instrument.
Safe state: temperature control and circulation off; on a lost link the bath goes on.

A write is answered with the value that was taken, which the thermostat limits by itself:
what differs from what was asked is refused and turned off.

Source:
    Peter Huber Kältemaschinenbau, Data Communication PB, V1.8.0, command table.
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
)
from labweb.domain.errors import DeviceError, FrameError, RejectedError

END = b"\r\n"
SETPOINT, INTERNAL, ERROR, PROCESS = 0x00, 0x01, 0x05, 0x07
STATE, SENSOR, CONTROL, CIRCULATION = 0x0A, 0x13, 0x14, 0x16
SERIAL_HIGH, SERIAL_LOW = 0x1B, 0x1C
LOWEST_SETPOINT, HIGHEST_SETPOINT = 0x30, 0x31

CONTROL_BIT, ERROR_BIT = 0x0001, 0x0100
HUNDREDTHS = 100.0
NO_SENSOR = -15100  # answer C504, table of temperatures
NOT_AVAILABLE = 0x7FFF
SIGN_BIT, WORD = 0x8000, 0x10000
ANSWER_S = 1.0

Temperature = Annotated[float, Range(-151.0, 327.0), Accuracy()]
Tolerance = Annotated[float, Range(0.01, 50.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One thermostat."""

    serial_count: Annotated[int, Range(0, 4_294_967_295)] = 0
    """Refuse a thermostat with another serial number; 0 accepts any."""

    sensor: Literal["internal", "process"] = "internal"
    """Reading that is controlled: the bath's, or that of the sensor in the process."""

    min_temperature_c: Temperature = -151.0
    max_temperature_c: Temperature = 327.0
    reach_limit_s: Annotated[float, Range(0.1, 42_000.0)] = 14_000.0
    """Longest time to reach a temperature."""

    settle_s: Annotated[float, Range(0.0, 600.0)] = 5.0
    """How long the reading must stay within tolerance."""

    grace_s: Annotated[float, Range(0.0, 600.0)] = 30.0
    """How long a held temperature may leave its tolerance."""

    start_s: Annotated[float, Range(0.0, 60.0)] = 2.0
    """Time to leave the thermostat alone after a start."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 1.0


def encode_read(address: int) -> bytes:
    r"""Build the frame that asks for a value.

    Example:
        >>> encode_read(0x01)
        b'{M01****\r\n'
    """
    return f"{{M{address:02X}****\r\n".encode("ascii")


def encode_write(address: int, value: int) -> bytes:
    r"""Build the frame that sets a value, a signed 16-bit number.

    Example:
        >>> encode_write(0x00, -2315)
        b'{M00F6F5\r\n'
    """
    return f"{{M{address:02X}{value % WORD:04X}\r\n".encode("ascii")


def decode_reply(frame: bytes, address: int) -> int:
    r"""Read the signed value of an answer.

    Raises:
        FrameError: Not an answer, or from another address.

    Example:
        >>> decode_reply(b"{S00FFCC\r\n", 0x00)
        -52
    """
    match = re.fullmatch(rb"\{S([0-9A-F]{2})([0-9A-F]{4})\r\n", frame)
    if match is None or int(match[1], 16) != address:
        raise FrameError(f"no answer from address {address:02X}", context={"frame": frame.hex()})
    value = int(match[2], 16)
    return value - WORD if value & SIGN_BIT else value


def decode_temperature(value: int) -> float:
    """Read a temperature.

    Raises:
        DeviceError: The sensor is missing or broken, or the thermostat has none.

    Example:
        >>> decode_temperature(4112)
        41.12
    """
    if value in {NO_SENSOR, NOT_AVAILABLE}:
        reason = "no sensor answers" if value == NO_SENSOR else "it is not available"
        raise DeviceError(f"no temperature: {reason}", code="device.alarm", context={"raw": value})
    return value / HUNDREDTHS


class HuberPb(Driver[ByteTransport, Config], Thermostat):
    """One thermostat."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the serial number, and refuse another thermostat than the one set."""
        serial = (self._read(SERIAL_HIGH) % WORD) * WORD + self._read(SERIAL_LOW) % WORD
        if self.config.serial_count not in {0, serial}:
            raise RejectedError(
                f"thermostat {serial} answers, expected {self.config.serial_count}",
                context={"serial_number": serial},
            )

    def halt(self) -> None:
        """Turn temperature control and circulation off."""
        self._write(CONTROL, 0)
        self._write(CIRCULATION, 0)

    @status(every_s=2.0)
    def temperature_c(self) -> Annotated[float, Accuracy()]:
        """Tell the reading that is controlled."""
        return self._temperature(INTERNAL if self.config.sensor == "internal" else PROCESS)

    @status(every_s=2.0)
    def bath_temperature_c(self) -> float:
        """Tell the reading of the thermostat's own bath."""
        return self._temperature(INTERNAL)

    @status(every_s=4.0)
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature."""
        return self._temperature(SETPOINT)

    @status(every_s=2.0)
    def is_controlling(self) -> bool:
        """Tell whether temperature control is on."""
        return bool(self._read(STATE) & CONTROL_BIT)

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
            low_c, high_c = self._temperature(LOWEST_SETPOINT), self._temperature(HIGHEST_SETPOINT)
            refuse_beyond("temperature", temperature_c, low_c, high_c)
            self._refuse_fault(self._read(STATE))
            return self.temperature_c()

    def _start(self, temperature_c: float) -> None:
        self._write(SENSOR, int(self.config.sensor == "process"))
        self._write(SETPOINT, round(temperature_c * HUNDREDTHS))
        self._write(CONTROL, 1)
        self.pause(self.config.start_s)

    def _reading_under_control(self) -> float:
        state = self._read(STATE)
        self._refuse_fault(state)
        if not state & CONTROL_BIT:
            self.pause(0)  # a stop from another thread is told as such
            raise DeviceError("temperature control went off by itself", code="device.alarm")
        return self.temperature_c()

    def _refuse_fault(self, state: int) -> None:
        if state & ERROR_BIT:
            error = self._read(ERROR)
            raise DeviceError(
                f"thermostat reports error {error}", code="device.alarm", context={"alarm": error}
            )

    def _temperatures(self) -> dict[str, Any]:
        return {
            "temperature_c": self.temperature_c(),
            "temperature_setpoint_c": self.temperature_setpoint_c(),
        }

    def _temperature(self, address: int) -> float:
        return decode_temperature(self._read(address))

    def _read(self, address: int) -> int:
        return self._exchange(encode_read(address), address)

    def _write(self, address: int, value: int) -> None:
        taken = self._exchange(encode_write(address, value), address)
        if taken != value:
            raise RejectedError(
                f"address {address:02X} holds {taken} after writing {value}",
                context={"taken": taken},
            )

    def _exchange(self, frame: bytes, address: int) -> int:
        answer = self.transport.exchange(frame, until=END, timeout_s=ANSWER_S)
        return decode_reply(answer, address)
