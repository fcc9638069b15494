"""A controller of pump and vent valve that keeps a vacuum."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class VacuumController(ABC):
    """Pressures are absolute. Setpoint and reading are never one field."""

    @abstractmethod
    def evacuate_to(self, pressure_kpa: float, tolerance_kpa: float) -> Report:
        """Pump down, and return once the reading is within tolerance.

        Effect:
            The controller keeps this pressure.
        """

    @abstractmethod
    def stop_pump(self) -> Report:
        """End the control of the pressure; the vent valve stays shut.

        Effect:
            The pump is off; what is under vacuum stays so as long as it is tight.
        """

    @abstractmethod
    def vent(self) -> Report:
        """Let gas in, and return once the pressure is atmospheric.

        Effect:
            The control is off and what was evacuated is full of gas.
        """

    @abstractmethod
    def pressure_kpa(self) -> float:
        """Tell the reading."""

    @abstractmethod
    def pressure_setpoint_kpa(self) -> float:
        """Tell the wanted pressure."""

    @abstractmethod
    def is_pumping(self) -> bool:
        """Tell whether the pump runs."""
