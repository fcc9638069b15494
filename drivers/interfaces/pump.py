"""A pump that draws liquid in and pushes it out by volume."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Pump(ABC):
    """A syringe pump: it holds what it has drawn in."""

    @abstractmethod
    def initialize(self) -> Report:
        """Find the plunger's zero.

        Effect:
            Whatever is in the syringe is pushed out.
        """

    @abstractmethod
    def aspirate(self, volume_ul: float, rate_ul_s: float) -> Report:
        """Draw liquid in through the selected port, and return once the plunger stands.

        Effect:
            `moved_ul` from the port into the syringe.
        """

    @abstractmethod
    def dispense(self, volume_ul: float, rate_ul_s: float) -> Report:
        """Push liquid out through the selected port, and return once the plunger stands.

        Effect:
            `moved_ul` from the syringe out of the port.
        """

    @abstractmethod
    def volume_ul(self) -> float | None:
        """Tell how much the syringe holds, from the plunger's position; None: nobody knows."""

    @abstractmethod
    def is_initialized(self) -> bool:
        """Tell whether the plunger's zero is known."""
