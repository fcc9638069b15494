"""An arm that plays the programs a person taught it."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Arm(ABC):
    """A robot arm. What a program does to matter, its teacher knows."""

    @abstractmethod
    def run_program(self, program: str) -> Report:
        """Load and play a program, and return once it has ended.

        Effect:
            All that the program does.
        """

    @abstractmethod
    def stop_program(self) -> Report:
        """End the program where it is.

        Effect:
            The arm stands; what it carries it still carries.
        """

    @abstractmethod
    def is_running(self) -> bool:
        """Tell whether a program runs."""

    @abstractmethod
    def robot_mode(self) -> str:
        """Tell the mode of the robot, in the maker's words."""

    @abstractmethod
    def safety_status(self) -> str:
        """Tell the state of the safety system, in the maker's words."""
