"""A rotary evaporator: a flask that turns in a heating bath, on a lift."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class RotaryEvaporator(ABC):
    """Bath, rotation and lift. Its vacuum is a device of its own."""

    @abstractmethod
    def heat_bath_to(self, temperature_c: float, tolerance_c: float) -> Report:
        """Heat the bath, and return once its reading has stayed within tolerance.

        Effect:
            The bath stays on with this setpoint.
        """

    @abstractmethod
    def stop_heating(self) -> Report:
        """Turn the bath off; what is hot cools by itself.

        Effect:
            The bath is off.
        """

    @abstractmethod
    def rotate(self, speed_rpm: float) -> Report:
        """Turn the flask, and return once the speed is reached.

        Effect:
            The drive stays on with this setpoint.
        """

    @abstractmethod
    def stop_rotating(self) -> Report:
        """Turn the drive off, and return once the flask stands.

        Effect:
            The drive is off.
        """

    @abstractmethod
    def raise_flask(self) -> Report:
        """Lift the flask out of the bath.

        Effect:
            The lift is up, as far as can be told.
        """

    @abstractmethod
    def lower_flask(self) -> Report:
        """Lower the flask into the bath.

        Effect:
            The lift is down, as far as can be told.
        """

    @abstractmethod
    def bath_temperature_c(self) -> float:
        """Tell the bath's reading."""

    @abstractmethod
    def bath_setpoint_c(self) -> float:
        """Tell the wanted temperature of the bath."""

    @abstractmethod
    def speed_rpm(self) -> float:
        """Tell the drive's reading."""

    @abstractmethod
    def speed_setpoint_rpm(self) -> float:
        """Tell the wanted speed."""
