"""A powder dispenser that weighs what it doses."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class PowderDispenser(ABC):
    """A head lets powder fall into the vial that stands on a balance under it."""

    @abstractmethod
    def dose(
        self, substance: str, target_mg: float, tolerance_ratio: float, sample_id: str
    ) -> Report:
        """Dose powder into the vial, and return once the balance confirms what fell.

        Effect:
            The mass of evidence `dosed_mg` has gone from the head into the vial.
        """

    @abstractmethod
    def open_door(self) -> Report:
        """Open the front door.

        Effect:
            The vial can be reached.
        """

    @abstractmethod
    def close_door(self) -> Report:
        """Close the front door.

        Effect:
            None on matter.
        """

    @abstractmethod
    def stop_dosing(self) -> Report:
        """End a dosing that goes on.

        Effect:
            No more powder falls; what fell is in the vial.
        """

    @abstractmethod
    def mass_mg(self) -> float:
        """Tell the reading of the balance now, steady or not."""

    @abstractmethod
    def is_stable(self) -> bool:
        """Tell whether the reading of the balance is steady."""

    @abstractmethod
    def is_door_open(self) -> bool | None:
        """Tell whether the front door is open; None: it moves, or is not detected."""

    @abstractmethod
    def head_substance(self) -> str | None:
        """Tell the substance of the head by its own label; None: no head is mounted."""

    @abstractmethod
    def head_mass_mg(self) -> float | None:
        """Tell the powder left in the head by its own counter; None: no head is mounted."""
