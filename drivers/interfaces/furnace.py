"""A furnace that follows a ramp to a temperature and keeps it."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Furnace(ABC):
    """A chamber or tube furnace. It heats; what is hot cools by itself."""

    @abstractmethod
    def ramp_to(self, temperature_c: float, ramp_k_min: float, tolerance_c: float) -> Report:
        """Follow a ramp to a temperature, and return once the reading has stayed near it.

        Effect:
            The control stays on with this setpoint.
        """

    @abstractmethod
    def hold(self, duration_s: float, temperature_c: float, tolerance_c: float) -> Report:
        """Keep a temperature that is already reached for a while, and watch it.

        Effect:
            The control stays on with this setpoint.
        """

    @abstractmethod
    def stop_heating(self) -> Report:
        """Turn the heater off; the furnace cools by itself.

        Effect:
            The heater is off.
        """

    @abstractmethod
    def acknowledge_alarm(self) -> Report:
        """Tell the furnace that its alarm was seen; it stays off.

        Effect:
            None on matter: the next start is not refused for this alarm.
        """

    @abstractmethod
    def temperature_c(self) -> float:
        """Tell the reading."""

    @abstractmethod
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature, at the end of the ramp."""

    @abstractmethod
    def is_heating(self) -> bool:
        """Tell whether the control is on."""

    @abstractmethod
    def is_door_open(self) -> bool:
        """Tell whether the door is open."""
