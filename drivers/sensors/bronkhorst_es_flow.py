"""Bronkhorst ES-FLOW ultrasonic flow meter for liquids.

Protocol: Modbus RTU, functions 3, 6 and 16; floats over two registers, upper half first.
Quality: bronze, simulated instrument; the register map is not checked on hardware.
Safe state: idle; a meter moves nothing.

The meter tells its flow in the unit that it is set to, and anybody on its line may set another:
so the unit is read with each value, before and after it. A unit of mass or of gas is refused.

Source:
    Bronkhorst, Modbus slave interface for digital instruments, 9.17.035: 4.4.1 functions, 4.4.6
    parameters. ES-FLOW instruction manual, 9.17.145, 3.4.2: measure, fmeasure, capacity.
    Operational instructions for digital multibus instruments, 9.17.023, 4.20: units.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import ClassVar

import msgspec

from drivers.base import Driver, Report, action, status
from drivers.interfaces.flow_sensor import FlowSensor
from drivers.sensors._transmitter import Transmitter, measured
from drivers.transports.modbus import RegisterTransport
from labweb.domain.errors import FrameError, RejectedError

# PDU addresses of 9.17.035, 4.4.6; a parameter is read whole.
CAPACITY, FMEASURE, FLOAT_LENGTH = 0x8168, 0xA100, 2
CAPACITY_UNIT, UNIT_LENGTH = 0x81F8, 4
SERIAL_NUMBER, SERIAL_LENGTH = 0xF118, 8

UL_S: Mapping[str, float] = {
    "l/min": 1e6 / 60,
    "ml/h": 1e3 / 3600,
    "ml/min": 1e3 / 60,
    "l/h": 1e6 / 3600,
    "mm3/s": 1.0,
    "cm3/min": 1e3 / 60,
}
"""Microlitres a second, by the unit of a meter of liquid volume; 9.17.023, 4.20."""

FULL_RATIO = 1.3107
"""The most that it tells of its capacity: what flows beyond, it does not say. 9.17.145, 3.4.2."""

NEAR_RATIO = 1e-4
"""How near the end a value counts as being at it: a float has seven digits."""


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One meter; its device number stands in the URL."""

    serial_number: str = ""
    """Number that it must tell; "": any."""


def decode_float(registers: tuple[int, ...]) -> float:
    """Read a float from two registers.

    Raises:
        FrameError: It is no number.

    Example:
        >>> decode_float((0x42C8, 0))
        100.0
    """
    (value,) = struct.unpack(">f", struct.pack(">HH", *registers))
    if not math.isfinite(value):
        raise FrameError("the meter tells no number", context={"registers": list(registers)})
    return float(value)


def decode_text(registers: tuple[int, ...]) -> str:
    """Read a text of two letters a register, up to the first zero.

    Raises:
        FrameError: It has letters beyond ASCII.

    Example:
        >>> decode_text((0x6C2F, 0x6800))
        'l/h'
    """
    data = struct.pack(f">{len(registers)}H", *registers).partition(b"\0")[0]
    try:
        return data.decode("ascii").strip()
    except UnicodeDecodeError as error:
        message = "the meter tells a text that is none"
        raise FrameError(message, context={"registers": list(registers)}) from error


class BronkhorstEsFlow(Transmitter, Driver[RegisterTransport, Config], FlowSensor):
    """One meter in one line."""

    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the serial number and the unit; refuse another meter, or one of another kind."""
        told = decode_text(self.transport.read_registers(SERIAL_NUMBER, SERIAL_LENGTH))
        wanted = self.config.serial_number
        if wanted and told != wanted:
            raise RejectedError(
                f"the meter {told!r} answers, expected {wanted!r}", context={"serial": told}
            )
        self._unit()

    @status(every_s=2.0)
    def flow_ul_s(self) -> float:
        """Tell the flow by volume; what flows backwards is negative."""
        return self._read()

    @action(timeout_s=10.0, recovery="R1", operation="read")
    def measure(self) -> Report:
        """Read once, as evidence `flow_ul_s`.

        Effect:
            None.
        """
        return measured(self, lambda: {"flow_ul_s": self._read()})

    def _read(self) -> float:
        unit = self._unit()
        capacity, flow = (
            decode_float(self.transport.read_registers(first, FLOAT_LENGTH))
            for first in (CAPACITY, FMEASURE)
        )
        after = self._unit()
        if after != unit:
            raise RejectedError(
                f"the meter was set from {unit} to {after} while it was read: read it again",
                context={"before": unit, "after": after},
            )
        if capacity <= 0:
            raise FrameError(f"the meter tells a capacity of {capacity:g} {unit}")
        if flow >= capacity * (FULL_RATIO - NEAR_RATIO):
            raise RejectedError(
                f"{flow:g} {unit} is the end of what the meter tells (capacity {capacity:g} "
                f"{unit}): more may flow",
                context={"flow": flow, "capacity": capacity, "unit": unit},
            )
        return flow * UL_S[unit]

    def _unit(self) -> str:
        told = decode_text(self.transport.read_registers(CAPACITY_UNIT, UNIT_LENGTH))
        if told not in UL_S:
            raise RejectedError(
                f"the meter tells its flow in {told!r}, which is no volume of liquid of "
                f"{', '.join(UL_S)}: set it to one of them",
                context={"unit": told},
            )
        return told
