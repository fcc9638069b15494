"""Sensors that stand in a liquid."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class PhSensor(ABC):
    """A pH electrode with its own thermometer."""

    @abstractmethod
    def measure(self) -> Report:
        """Read pH and temperature together, as evidence `value_ph` and `temperature_c`.

        Effect:
            None.
        """

    @abstractmethod
    def value_ph(self) -> float:
        """Tell the pH."""

    @abstractmethod
    def temperature_c(self) -> float:
        """Tell the liquid's temperature."""
