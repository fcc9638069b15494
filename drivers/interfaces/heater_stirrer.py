"""A plate that heats and stirs the vessel on it."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class HeaterStirrer(ABC):
    """A heating plate with a magnetic stirrer. Setpoint and reading are never one field."""

    @abstractmethod
    def heat_to(self, temperature_c: float, tolerance_c: float) -> Report:
        """Heat, and return once the reading has stayed within tolerance.

        Effect:
            The heater stays on with this setpoint.
        """

    @abstractmethod
    def stop_heating(self) -> Report:
        """Turn the heater off; what is hot cools by itself.

        Effect:
            The heater is off.
        """

    @abstractmethod
    def stir(self, speed_rpm: float) -> Report:
        """Stir, and return once the speed is reached.

        Effect:
            The motor stays on with this setpoint.
        """

    @abstractmethod
    def stop_stirring(self) -> Report:
        """Turn the motor off, and return once it stands.

        Effect:
            The motor is off.
        """

    @abstractmethod
    def hold(self, duration_s: float, temperature_c: float, tolerance_c: float) -> Report:
        """Keep a temperature that is already reached for a while, and watch it.

        Effect:
            The heater stays on with this setpoint.
        """

    @abstractmethod
    def temperature_c(self) -> float:
        """Tell the reading that is controlled: the medium's, unless set otherwise."""

    @abstractmethod
    def plate_temperature_c(self) -> float:
        """Tell the plate's reading."""

    @abstractmethod
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature."""

    @abstractmethod
    def speed_rpm(self) -> float:
        """Tell the motor's reading."""

    @abstractmethod
    def speed_setpoint_rpm(self) -> float:
        """Tell the wanted speed."""
