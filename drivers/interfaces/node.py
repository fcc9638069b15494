"""Something that brings its own brain, and tells, answers and carries out what is listed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from drivers.base import Report


class Node(ABC):
    """A foreign node. What it does to matter, its maker knows."""

    @abstractmethod
    def values(self) -> dict[str, Any]:
        """Tell what each topic told last; one that is silent is null."""

    @abstractmethod
    def feedback(self) -> dict[str, Any]:
        """Tell how far the goal is that is under way, in the node's words."""

    @abstractmethod
    def is_present(self) -> bool:
        """Tell whether everything that is listed is there."""

    @abstractmethod
    def run_goal(self, goal: str, arguments: dict[str, Any]) -> Report:
        """Send a goal that is listed, and return once it has succeeded.

        Effect:
            All that the node does for the goal.
        """

    @abstractmethod
    def call(self, service: str, arguments: dict[str, Any]) -> Report:
        """Call a service that is listed, and return what it answered.

        Effect:
            All that the node does for the call.
        """
