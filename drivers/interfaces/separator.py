"""A vessel with a stirrer and a drain, in which two liquid phases are parted."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal

from drivers.base import Report


class Separator(ABC):
    """Stirs two liquids, and lets the lower one out until their boundary is at the neck.

    Gravity drains, and nothing meters it. What went is told only where the boundary was seen
    and the time agrees with it; otherwise nobody knows, and a person looks.
    """

    @abstractmethod
    def stir(self, speed_rpm: float, duration_s: float) -> Report:
        """Stir for a time with the drain closed, and return once the stirrer stands.

        Effect:
            The phases are mixed, and have not settled yet.
        """

    @abstractmethod
    def drain_lower_phase(self, volume_ul: float, reading: Literal["falls", "rises"]) -> Report:
        """Let the lower phase out, and close the drain when the boundary is at the neck.

        Args:
            volume_ul: What the lower phase is by the lab's record.
            reading: What that of the sensor does at the boundary: it `falls` where the upper
                phase gives less of a signal, and `rises` where it gives more.

        Effect:
            `moved_ul` has run out of the vessel, and the drain is closed.
        """

    @abstractmethod
    def close_drain(self) -> Report:
        """Close the drain, and return once it is shown to be closed.

        Effect:
            Nothing runs out any more.
        """

    @abstractmethod
    def confirm_drain_closed(self) -> Report:
        """Take the drain for closed as it stands: a person has looked, and it is.

        Effect:
            Nothing moves.
        """

    @abstractmethod
    def speed_rpm(self) -> float:
        """Tell the reading of the stirrer."""

    @abstractmethod
    def is_drain_closed(self) -> bool | None:
        """Tell whether the drain is closed; None: nobody knows."""

    @abstractmethod
    def neck_signal_count(self) -> int:
        """Tell the signal of the sensor at the neck, in its own counts."""

    @abstractmethod
    def has_liquid_at_neck(self) -> bool:
        """Tell whether liquid of any phase stands at the neck."""
