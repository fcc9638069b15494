"""A pump that drives a syringe without knowing what is in it."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class InfusionPump(ABC):
    """A threaded drive with a syringe clamped in: it counts what it moved, and has no zero."""

    @abstractmethod
    def infuse(self, volume_ul: float, rate_ul_s: float) -> Report:
        """Push liquid out of the syringe, and return once the volume is reached.

        Effect:
            `moved_ul` from the syringe out of its outlet.
        """

    @abstractmethod
    def withdraw(self, volume_ul: float, rate_ul_s: float) -> Report:
        """Draw liquid into the syringe, and return once the volume is reached.

        Effect:
            `moved_ul` from the outlet into the syringe.
        """

    @abstractmethod
    def infused_ul(self) -> float:
        """Tell what the last stroke has pushed out, by the pump's count."""

    @abstractmethod
    def withdrawn_ul(self) -> float:
        """Tell what the last stroke has drawn in, by the pump's count."""

    @abstractmethod
    def is_running(self) -> bool:
        """Tell whether the drive turns."""
