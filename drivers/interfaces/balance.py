"""A balance."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Balance(ABC):
    """Weighs what stands on it."""

    @abstractmethod
    def tare(self) -> Report:
        """Take what is on the pan as zero, once it is steady.

        Effect:
            None on matter; later readings are net of this tare.
        """

    @abstractmethod
    def weigh(self) -> Report:
        """Wait until the reading is steady and return it as evidence `mass_mg`.

        Effect:
            None.
        """

    @abstractmethod
    def mass_mg(self) -> float:
        """Tell the reading now, steady or not."""

    @abstractmethod
    def is_stable(self) -> bool:
        """Tell whether the reading is steady."""
