"""A thermometer that only measures."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class TemperatureSensor(ABC):
    """A probe in a liquid, a block or a vapour."""

    @abstractmethod
    def measure(self) -> Report:
        """Read once, as evidence with `temperature_c`.

        Effect:
            None.
        """

    @abstractmethod
    def temperature_c(self) -> float:
        """Tell the temperature at the probe."""
