"""Fingers that close on a thing and let it go."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Gripper(ABC):
    """A gripper with two fingers. The width is that between them."""

    @abstractmethod
    def initialize(self) -> Report:
        """Find the ends of the stroke.

        Effect:
            The fingers close and open; nothing may be between them.
        """

    @abstractmethod
    def grip(self, width_mm: float, speed_mm_s: float, force_n: float) -> Report:
        """Close on a thing, at most down to a width, and return once it is held.

        Effect:
            The thing is held between the fingers.
        """

    @abstractmethod
    def release(self, width_mm: float, speed_mm_s: float) -> Report:
        """Open to a width.

        Effect:
            What was held is let go; it falls where nothing carries it.
        """

    @abstractmethod
    def width_mm(self) -> float:
        """Tell the width between the fingers."""

    @abstractmethod
    def is_holding(self) -> bool:
        """Tell whether the fingers were stopped by a thing while they closed."""

    @abstractmethod
    def is_initialized(self) -> bool:
        """Tell whether the ends of the stroke are known."""
