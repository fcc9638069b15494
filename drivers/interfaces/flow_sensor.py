"""A meter of the liquid that flows through it."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class FlowSensor(ABC):
    """A meter in a line. It holds nothing and stops nothing."""

    @abstractmethod
    def measure(self) -> Report:
        """Read once, as evidence with `flow_ul_s`.

        Effect:
            None.
        """

    @abstractmethod
    def flow_ul_s(self) -> float:
        """Tell the flow by volume; what flows backwards is negative."""
