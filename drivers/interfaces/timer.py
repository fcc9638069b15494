"""A clock that a workflow waits on."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Timer(ABC):
    """Waits."""

    @abstractmethod
    def wait(self, duration_s: float) -> Report:
        """Return after the duration.

        Effect:
            None.
        """
