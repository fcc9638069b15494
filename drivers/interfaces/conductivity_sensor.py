"""A sensor of electric conductivity."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class ConductivitySensor(ABC):
    """Electrodes in a liquid."""

    @abstractmethod
    def measure(self) -> Report:
        """Read once, as evidence with `conductivity_us_cm` and what else the sensor tells.

        Effect:
            None.
        """

    @abstractmethod
    def conductivity_us_cm(self) -> float:
        """Tell the conductivity."""
