"""Seeed Studio RS-485 sensor of conductivity and dissolved solids, S-EC/TDS-01.

Protocol: Modbus RTU, 9600 8N1, function 3 or 4; registers 0 temperature, 1-2 EC, 3 salinity, 4 TDS.
Quality: bronze, simulated instrument; the register map is not checked on hardware.
Safe state: idle; a sensor moves nothing.

Source:
    Seeed Technology, S-EC/TDS-01 RS485 sensor user manual, Modbus communication protocol. Seeed
    Technology, Liquid EC & TDS Sensor user manual 1.1, specifications: conductivity ±3 % up to
    10 000 µS/cm and ±5 % up to 20 000 µS/cm, of which the larger holds wherever it reads. Of the
    dissolved solids, which are inferred, nothing is stated.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, NamedTuple

import msgspec

from drivers.base import Accuracy, Driver, Report, action, status
from drivers.interfaces.conductivity_sensor import ConductivitySensor
from drivers.interfaces.tds_sensor import TdsSensor
from drivers.sensors._transmitter import Transmitter, measured, signed
from drivers.transports.modbus import RegisterTransport
from labweb.domain.errors import FrameError

FIRST_REGISTER, REGISTERS_COUNT = 0, 5
HUNDREDTHS = 100.0
LOWEST_C, HIGHEST_C = -55.0, 150.0
HIGHEST_TDS_PPM = 20_000


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One sensor; its device number stands in the URL."""

    table: Literal["holding", "input"] = "holding"
    """Registers are read with function 3 (holding) or 4 (input)."""


class TdsMeasurement(NamedTuple):
    """What one reading tells."""

    temperature_c: float
    conductivity_us_cm: float
    salinity_ppm: float
    tds_ppm: float


def decode_registers(registers: tuple[int, ...]) -> TdsMeasurement:
    """Read temperature, which may be negative, and what the cell tells.

    Raises:
        FrameError: A value that no liquid has: the cell or its cable is broken.

    Example:
        >>> decode_registers((2512, 0, 1413, 700, 750)).conductivity_us_cm
        1413.0
    """
    raw_temperature, high, low, salinity, tds = registers
    measurement = TdsMeasurement(
        signed(raw_temperature) / HUNDREDTHS, float((high << 16) + low), float(salinity), float(tds)
    )
    is_real = LOWEST_C <= measurement.temperature_c <= HIGHEST_C
    if not is_real or measurement.tds_ppm > HIGHEST_TDS_PPM:
        raise FrameError(
            f"sensor tells {tds} mg/L at {measurement.temperature_c:g} °C",
            context={"registers": list(registers)},
        )
    return measurement


class SeeedTds(Transmitter, Driver[RegisterTransport, Config], ConductivitySensor, TdsSensor):
    """One sensor of conductivity and dissolved solids."""

    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Read once: this sensor has no name, so plausible readings must do."""
        self._read()

    @status(every_s=2.0)
    def conductivity_us_cm(self) -> Annotated[float, Accuracy(ratio=0.05)]:
        """Tell the conductivity."""
        return self._read().conductivity_us_cm

    @status(every_s=2.0)
    def tds_ppm(self) -> float:
        """Tell the dissolved solids, in mg/L."""
        return self._read().tds_ppm

    @status(every_s=2.0)
    def temperature_c(self) -> float:
        """Tell the liquid's temperature."""
        return self._read().temperature_c

    @action(timeout_s=10.0, recovery="R1", operation="read")
    def measure(self) -> Report:
        """Read all values together, as evidence.

        Effect:
            None.
        """
        return measured(self, lambda: self._read()._asdict())

    def _read(self) -> TdsMeasurement:
        registers = self.transport.read_registers(
            FIRST_REGISTER, REGISTERS_COUNT, table=self.config.table
        )
        return decode_registers(registers)
