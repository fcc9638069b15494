"""Seeed Studio RS-485 pH and temperature sensor.

Protocol: Modbus, function 3 or 4; register 0 temperature, register 1 pH, both in hundredths.
Quality: bronze, simulated instrument; the register map is not checked on hardware.
Safe state: idle; a sensor moves nothing.

Source:
    Seeed Technology, S-pH-01 RS485 pH Sensor User Manual, Modbus communication protocol;
    specifications: ±0.1 pH, ±0.5 °C.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, NamedTuple

import msgspec

from drivers.base import Accuracy, Driver, Range, Report, action, status
from drivers.interfaces.sensor import PhSensor
from drivers.sensors._transmitter import Transmitter, measured, signed
from drivers.transports.modbus import RegisterTransport
from labweb.domain.errors import FrameError

FIRST_REGISTER = 0
REGISTERS_COUNT = 2
HUNDREDTHS = 100.0

LOWEST_C, HIGHEST_C = -55.0, 150.0
HIGHEST_PH = 14.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One sensor; its device number stands in the URL."""

    table: Literal["holding", "input"] = "holding"
    """Registers are read with function 3 (holding) or 4 (input)."""

    offset_ph: Annotated[float, Range(-2.0, 2.0)] = 0.0
    """Added to the reading: what the last calibration found."""


class PhMeasurement(NamedTuple):
    """A decoded pair of readings."""

    value_ph: float
    temperature_c: float


def decode_registers(registers: tuple[int, ...]) -> PhMeasurement:
    """Read temperature, which may be negative, and pH.

    Raises:
        FrameError: A value that no liquid has: the electrode or its cable is broken.

    Example:
        >>> decode_registers((2512, 701))
        Measurement(value_ph=7.01, temperature_c=25.12)
    """
    raw_temperature, raw_ph = registers
    measurement = PhMeasurement(raw_ph / HUNDREDTHS, signed(raw_temperature) / HUNDREDTHS)
    is_real = LOWEST_C <= measurement.temperature_c <= HIGHEST_C
    if not is_real or measurement.value_ph > HIGHEST_PH:
        raise FrameError(
            f"sensor tells {measurement.value_ph:g} pH at {measurement.temperature_c:g} °C",
            context={"registers": list(registers)},
        )
    return measurement


class SeeedPh(Transmitter, Driver[RegisterTransport, Config], PhSensor):
    """One pH sensor."""

    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Read once: this sensor has no name, so plausible readings must do."""
        self._read()

    @status(every_s=2.0)
    def value_ph(self) -> Annotated[float, Accuracy(absolute=0.1)]:
        """Tell the pH."""
        return self._read().value_ph

    @status(every_s=2.0)
    def temperature_c(self) -> Annotated[float, Accuracy(absolute=0.5)]:
        """Tell the liquid's temperature."""
        return self._read().temperature_c

    @action(timeout_s=10.0, recovery="R1", operation="read")
    def measure(self) -> Report:
        """Read pH and temperature together, as evidence `value_ph` and `temperature_c`.

        Effect:
            None.
        """
        return measured(self, lambda: self._read()._asdict())

    def _read(self) -> PhMeasurement:
        registers = self.transport.read_registers(
            FIRST_REGISTER, REGISTERS_COUNT, table=self.config.table
        )
        raw = decode_registers(registers)
        return raw._replace(value_ph=round(raw.value_ph + self.config.offset_ph, 3))
