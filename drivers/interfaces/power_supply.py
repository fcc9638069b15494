"""A laboratory supply of direct current."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class PowerSupply(ABC):
    """One output that keeps its voltage or its current, whichever is reached first."""

    @abstractmethod
    def supply(self, voltage_v: float, current_ma: float) -> Report:
        """Turn the output on with a voltage and a limit of current, and measure both.

        Effect:
            The output stays on with these setpoints.
        """

    @abstractmethod
    def stop_supply(self) -> Report:
        """Turn the output off.

        Effect:
            No current flows.
        """

    @abstractmethod
    def voltage_v(self) -> float:
        """Tell the voltage at the terminals."""

    @abstractmethod
    def current_ma(self) -> float:
        """Tell the current that flows."""

    @abstractmethod
    def voltage_setpoint_v(self) -> float:
        """Tell the wanted voltage."""

    @abstractmethod
    def current_setpoint_ma(self) -> float:
        """Tell the limit of current."""
