"""A bath or circulator that heats and cools."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Thermostat(ABC):
    """A circulating thermostat. Setpoint and reading are never one field."""

    @abstractmethod
    def reach_temperature(self, temperature_c: float, tolerance_c: float) -> Report:
        """Heat or cool, and return once the reading has stayed within tolerance.

        Effect:
            Temperature control and circulation stay on with this setpoint.
        """

    @abstractmethod
    def hold(self, duration_s: float, temperature_c: float, tolerance_c: float) -> Report:
        """Keep a temperature that is already reached for a while, and watch it.

        Effect:
            Temperature control and circulation stay on with this setpoint.
        """

    @abstractmethod
    def stop_control(self) -> Report:
        """Turn temperature control and circulation off; the bath drifts to the room's.

        Effect:
            Heater, compressor and pump are off.
        """

    @abstractmethod
    def temperature_c(self) -> float:
        """Tell the reading that is controlled."""

    @abstractmethod
    def bath_temperature_c(self) -> float:
        """Tell the reading of the thermostat's own bath."""

    @abstractmethod
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature."""

    @abstractmethod
    def is_controlling(self) -> bool:
        """Tell whether temperature control is on."""
