"""A valve with two positions round a sample loop."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal

from drivers.base import Report


class InjectionValve(ABC):
    """A six-port valve: the loop is filled in one position and flushed in the other."""

    @abstractmethod
    def select_position(self, position: Literal["load", "inject"]) -> Report:
        """Turn to a position, and return once the valve stands there.

        Effect:
            The loop's contents come into the way of the other pair of ports.
        """

    @abstractmethod
    def position(self) -> Literal["load", "inject"]:
        """Tell the position."""
