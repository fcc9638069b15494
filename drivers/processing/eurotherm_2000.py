"""Eurotherm temperature controller of the 2000 series.

Protocol: Modbus, functions 3 and 6; registers 1 reading, 2 setpoint, 111 and 112 its limits.
Quality: bronze, simulated instrument; the register map is not checked on hardware.
Safe state: setpoint at the rest temperature that is set; on a lost link the controller goes on.

The controller has no register to turn it off: it rests when its setpoint is below what it
controls. Values are whole numbers with as many decimals as the display shows.

Source:
    Eurotherm, 2000 series communications handbook, table of Modbus addresses, as public
    drivers have it.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Accuracy, Driver, Quantity, Range, Report, action, before_acting, status
from drivers.interfaces.temperature_controller import TemperatureController
from drivers.transports.modbus import RegisterTransport
from drivers.waiting import (
    TemperatureControl,
    once_started,
    refuse_beyond,
    refuse_untaken,
)
from labweb.domain.errors import DeviceError

READING, SETPOINT, HIGHEST_SETPOINT, LOWEST_SETPOINT = 1, 2, 111, 112
SIGN_BIT, WORD = 0x8000, 0x10000

Temperature = Annotated[float, Range(-200.0, 1500.0), Accuracy()]
Tolerance = Annotated[float, Range(0.1, 50.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One controller; its device number stands in the URL."""

    decimals_count: Annotated[int, Range(0, 2)]
    """Decimals that its display shows."""

    rest_temperature_c: Temperature
    """Setpoint at which it rests."""

    min_temperature_c: Temperature = -200.0
    max_temperature_c: Temperature
    """Highest temperature that this lab allows."""

    reach_limit_s: Annotated[float, Range(0.1, 42_000.0)] = 14_000.0
    """Longest time to reach a temperature."""

    settle_s: Annotated[float, Range(0.0, 600.0)] = 5.0
    """How long the reading must stay within tolerance."""

    grace_s: Annotated[float, Range(0.0, 600.0)] = 30.0
    """How long a held temperature may leave its tolerance."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 1.0


class Eurotherm2000(Driver[RegisterTransport, Config], TemperatureController):
    """One temperature controller."""

    transport_type: ClassVar[type] = RegisterTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Read the limits of the setpoint, which lie in order in every controller."""
        low_c, high_c = self._read(LOWEST_SETPOINT), self._read(HIGHEST_SETPOINT)
        if low_c >= high_c:
            raise DeviceError(f"limits {low_c:g} and {high_c:g} °C are no controller's")

    def halt(self) -> None:
        """Set the rest temperature."""
        self._set(self.config.rest_temperature_c)

    @status(every_s=2.0)
    def temperature_c(self) -> Annotated[float, Accuracy()]:
        """Tell the reading.

        Raises:
            DeviceError: The sensor is broken: the reading is out of any range.
        """
        reading_c = self._read(READING)
        if not -200.0 <= reading_c <= 3000.0:
            raise DeviceError(
                f"reading is {reading_c:g} °C: is the sensor broken?",
                code="device.alarm",
                context={"reading": reading_c},
            )
        return reading_c

    @status(every_s=4.0)
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature."""
        return self._read(SETPOINT)

    @action(timeout_s=43_200.0, recovery="R1", hazards=("heat",))
    def reach_temperature(self, temperature_c: Temperature, tolerance_c: Tolerance) -> Report:
        """Return once the reading has stayed within tolerance.

        Raises:
            DeviceError: Not reached in time, a broken sensor, or stopped: the controller
                rests, and `context["temperature_c"]` says how far it came (PARTIAL).

        Effect:
            The controller goes on with this setpoint.
        """
        self._check_start(temperature_c)
        return self._control.reach(temperature_c, tolerance_c)

    @action(timeout_s=604_800.0, recovery="R3", hazards=("heat",))
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
            DeviceError: It left the tolerance for longer than the grace time, or stopped: the
                controller rests, and `context["held_s"]` says after how long (PARTIAL).

        Effect:
            The controller goes on with this setpoint.
        """
        reading_c = self._check_start(temperature_c)
        return self._control.hold(reading_c, duration_s, temperature_c, tolerance_c)

    @action(timeout_s=30.0, recovery="R1")
    def stop_control(self) -> Report:
        """Set the rest temperature; what is hot cools by itself.

        Effect:
            No more heat is asked for above the rest temperature.
        """
        with once_started(self.halt, self._temperatures, driver=self):
            self.halt()
            return Report(evidence=self._temperatures())

    @property
    def _control(self) -> TemperatureControl:
        return TemperatureControl(
            driver=self,
            read=self.temperature_c,
            begin=self._set,
            end=self.halt,
            describe=self._temperatures,
        )

    def _check_start(self, temperature_c: float) -> float:
        """Return the reading before anything is sent that acts."""
        self.refuse_if_stopped()
        low_c, high_c = self.config.min_temperature_c, self.config.max_temperature_c
        refuse_beyond("temperature", temperature_c, low_c, high_c)
        with before_acting():
            low_c, high_c = self._read(LOWEST_SETPOINT), self._read(HIGHEST_SETPOINT)
            refuse_beyond("temperature", temperature_c, low_c, high_c)
            return self.temperature_c()

    def _temperatures(self) -> dict[str, Any]:
        return {
            "temperature_c": self.temperature_c(),
            "temperature_setpoint_c": self._read(SETPOINT),
        }

    def _set(self, temperature_c: float) -> None:
        self.transport.write_register(SETPOINT, round(temperature_c * self._scale) % WORD)
        taken_c = self._read(SETPOINT)
        refuse_untaken("setpoint", taken_c, temperature_c, resolution=0.51 / self._scale)

    def _read(self, address: int) -> float:
        raw = self.transport.read_registers(address, count=1)[0]
        return (raw - WORD if raw & SIGN_BIT else raw) / self._scale

    @property
    def _scale(self) -> int:
        return int(10**self.config.decimals_count)
