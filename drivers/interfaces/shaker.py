"""An orbital shaker that locks the plate on it."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Shaker(ABC):
    """Shakes a plate; the plate is locked while it does."""

    @abstractmethod
    def shake(self, speed_rpm: float, ramp_s: float) -> Report:
        """Lock the plate and shake it, and return once the ramp is over.

        Effect:
            The shaker stays on with this setpoint.
        """

    @abstractmethod
    def stop_shaking(self) -> Report:
        """Stop, and return once the plate stands in its home position.

        Effect:
            The shaker is off; the plate stays locked.
        """

    @abstractmethod
    def lock_plate(self) -> Report:
        """Close the clamps.

        Effect:
            The plate cannot be taken.
        """

    @abstractmethod
    def unlock_plate(self) -> Report:
        """Open the clamps of a shaker that stands.

        Effect:
            The plate can be taken.
        """

    @abstractmethod
    def speed_rpm(self) -> float:
        """Tell the speed of the table."""
