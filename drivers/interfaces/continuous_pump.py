"""A pump that goes on and on: peristaltic, or with alternating pistons."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class ContinuousPump(ABC):
    """A pump with an inlet and an outlet; it holds nothing and ends nowhere by itself."""

    @abstractmethod
    def start_flow(self, rate_ul_s: float) -> Report:
        """Pump from inlet to outlet at a rate, and return while it goes on.

        Effect:
            Liquid moves until `stop_flow`; how much is the rate by the time.
        """

    @abstractmethod
    def stop_flow(self) -> Report:
        """Stop pumping.

        Effect:
            Nothing moves any more.
        """

    @abstractmethod
    def deliver(self, volume_ul: float, rate_ul_s: float) -> Report:
        """Pump a volume from inlet to outlet, and return once the pump stands.

        Effect:
            `moved_ul` from the inlet to the outlet, by rate and time.
        """

    @abstractmethod
    def rate_setpoint_ul_s(self) -> float | None:
        """Tell the rate that is set, running or not; None: nobody knows."""

    @abstractmethod
    def is_running(self) -> bool | None:
        """Tell whether the pump runs; None: nobody knows."""
