"""A controller that keeps a block, an oven or a plate at a temperature."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class TemperatureController(ABC):
    """A closed loop that a setpoint starts."""

    @abstractmethod
    def reach_temperature(self, temperature_c: float, tolerance_c: float) -> Report:
        """Return once the reading has stayed within tolerance.

        Effect:
            The controller goes on with this setpoint.
        """

    @abstractmethod
    def hold(self, duration_s: float, temperature_c: float, tolerance_c: float) -> Report:
        """Keep a temperature that is already reached for a while, and watch it.

        Effect:
            The controller goes on with this setpoint.
        """

    @abstractmethod
    def stop_control(self) -> Report:
        """Bring the controller to its safe state; what is hot cools by itself.

        Effect:
            No more heat is asked for.
        """

    @abstractmethod
    def temperature_c(self) -> float:
        """Tell the reading."""
