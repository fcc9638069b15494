"""Simex TRS-02a temperature transducer for a Pt100 probe.

Protocol: Modbus RTU, 9600 8N1, functions 3 and 6; register 1 tenths of °C, register 2 its status.
Quality: bronze, simulated instrument; frames as the maker publishes them.
Safe state: idle; a sensor moves nothing.

Result and status are read together. Asked for the result alone the transducer tells a fault of
the probe by an exception, and afterwards the last good result would pass for a new one.

Source:
    Simex, TRS-02a user manual, firmware 2.04 or higher: 6.1 registers, 6.3 errors, 6.4 frames.
    Chapter 3 gives an error of ±0.2 % and does not say of what: no accuracy is stated here.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import msgspec

from drivers.base import Accuracy, Driver, Report, action, status
from drivers.interfaces.temperature_sensor import TemperatureSensor
from drivers.sensors._transmitter import Transmitter, measured, signed
from drivers.transports.modbus import RegisterTransport
from labweb.domain.errors import FrameError, RejectedError

RESULT, RESULT_AND_STATUS = 0x01, 2  # 6.1: the status is the next register
IDENTITY, MODEL_ID = 0x21, 0x0076  # 6.1
TENTHS = 10.0
LOWEST_C, HIGHEST_C = -50.0, 550.0  # chapter 3

BROKEN, SHORT = 0xA0, 0x60
FAULTS = {
    0x10: "water is in its housing",
    0x20: "its probe is damaged",
    0x40: "the probe is below -50 °C, or damaged",
    0x80: "the probe is above 550 °C, or damaged",
}
"""6.3; several add up."""


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One transducer; its device number stands in the URL."""


def faults_of(told: int) -> str:
    """Say what a status means; "" when nothing is wrong.

    Example:
        >>> faults_of(0xA0), faults_of(0x50)
        ('the line to its probe is broken', 'water is in its housing; the probe is below -50 °C, or damaged')
    """  # noqa: E501 - an answer of two faults
    line = {BROKEN: "the line to its probe is broken", SHORT: "its probe is short-circuited"}
    found = next((code for code in line if told & code == code), 0)
    named = [text for bit, text in FAULTS.items() if told & ~found & bit]
    known = found | sum(FAULTS)
    unknown = [f"its status is 0x{told:02X}"] if told & ~known else []
    return "; ".join([*([line[found]] if found else []), *named, *unknown])


def decode_registers(registers: tuple[int, ...]) -> float:
    """Read a temperature that the transducer stands by.

    Raises:
        RejectedError: Its status tells what is wrong; the number is the last good one.
        FrameError: The number is none that it can measure.

    Example:
        >>> decode_registers((0xFFF6, 0))
        -1.0
    """
    raw, told = registers
    temperature_c = signed(raw) / TENTHS
    wrong = faults_of(told)
    if wrong:
        raise RejectedError(
            f"the transducer measures nothing: {wrong}",
            context={"status": told, "last_temperature_c": temperature_c},
        )
    if not LOWEST_C <= temperature_c <= HIGHEST_C:
        raise FrameError(
            f"the transducer tells {temperature_c:g} °C, beyond {LOWEST_C:g} to {HIGHEST_C:g} °C",
            context={"registers": list(registers)},
        )
    return temperature_c


class SimexTrs02a(Transmitter, Driver[RegisterTransport, Config], TemperatureSensor):
    """One transducer with its probe."""

    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the identification code, and refuse another device."""
        (told,) = self.transport.read_registers(IDENTITY, 1)
        if told != MODEL_ID:
            raise RejectedError(
                f"a device of code 0x{told:04X} answers; a TRS-02a has 0x{MODEL_ID:04X}",
                context={"identity": told},
            )

    @status(every_s=2.0)
    def temperature_c(self) -> Annotated[float, Accuracy()]:
        """Tell the temperature at the probe."""
        return self._read()

    @action(timeout_s=10.0, recovery="R1", operation="read")
    def measure(self) -> Report:
        """Read once, as evidence `temperature_c`.

        Effect:
            None.
        """
        return measured(self, lambda: {"temperature_c": self._read()})

    def _read(self) -> float:
        return decode_registers(self.transport.read_registers(RESULT, RESULT_AND_STATUS))
