"""A robot that moves liquid between the wells on its deck, with tips that are thrown away."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class LiquidHandler(ABC):
    """One pipette over a deck. A place is named by slot and well: `2`, `A1`.

    A tip holds what was drawn up: half-moved liquid has a place there.
    """

    @abstractmethod
    def initialize(self) -> Report:
        """Find the zero of all axes, and take up the deck as the settings tell it.

        Effect:
            Gantry and plunger move; what a tip holds is pushed out.
        """

    @abstractmethod
    def pick_up_tip(self, slot: str, well: str) -> Report:
        """Put on the tip that stands in a rack.

        Effect:
            The tip has gone from the rack to the pipette.
        """

    @abstractmethod
    def drop_tip(self) -> Report:
        """Throw the tip away, with what it holds.

        Effect:
            The tip lies in the waste, with what it held.
        """

    @abstractmethod
    def aspirate(self, slot: str, well: str, volume_ul: float, rate_ul_s: float) -> Report:
        """Draw liquid from a well into the tip.

        Effect:
            `moved_ul` from the well into the tip.
        """

    @abstractmethod
    def dispense(self, slot: str, well: str, volume_ul: float, rate_ul_s: float) -> Report:
        """Push liquid from the tip into a well.

        Effect:
            `moved_ul` from the tip into the well.
        """

    @abstractmethod
    def transfer_liquid(
        self,
        source_slot: str,
        source_well: str,
        target_slot: str,
        target_well: str,
        volume_ul: float,
        rate_ul_s: float,
    ) -> Report:
        """Move liquid from well to well, with the empty tip that is on.

        Effect:
            `moved_ul` from the source into the target.
        """

    @abstractmethod
    def is_initialized(self) -> bool:
        """Tell whether axes and deck are known."""

    @abstractmethod
    def has_tip(self) -> bool | None:
        """Tell whether a tip is on; None: nobody knows."""

    @abstractmethod
    def tip_volume_ul(self) -> float | None:
        """Tell how much the tip holds; None: nobody knows."""

    @abstractmethod
    def running_state(self) -> str:
        """Tell what the robot does, in its own words; `none`: it has no run."""
