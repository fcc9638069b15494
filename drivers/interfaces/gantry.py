"""A tool on three straight axes."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Gantry(ABC):
    """Three axes in machine coordinates. What the tool does, another device knows."""

    @abstractmethod
    def initialize(self) -> Report:
        """Find the zero of every axis.

        Effect:
            Each axis runs to its switch; the way there has to be free.
        """

    @abstractmethod
    def move_to(self, x_mm: float, y_mm: float, z_mm: float, speed_mm_s: float) -> Report:
        """Move in a straight line, and return once the tool stands there.

        Effect:
            The tool, and what it carries, are at this place.
        """

    @abstractmethod
    def stop_moving(self) -> Report:
        """End the move where it is.

        Effect:
            The axes stand.
        """

    @abstractmethod
    def x_mm(self) -> float:
        """Tell the place on the first axis."""

    @abstractmethod
    def y_mm(self) -> float:
        """Tell the place on the second axis."""

    @abstractmethod
    def z_mm(self) -> float:
        """Tell the place on the third axis."""

    @abstractmethod
    def is_moving(self) -> bool:
        """Tell whether an axis moves."""

    @abstractmethod
    def machine_state(self) -> str:
        """Tell the state of the controller, in its maker's words."""
