"""One channel of a battery cycler."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class BatteryTester(ABC):
    """A channel that takes a cell through the steps of a protocol."""

    @abstractmethod
    def start_test(self, protocol_path: str, backup_path: str, barcode: str) -> Report:
        """Begin a protocol on the cell, and return once the channel works.

        Effect:
            The cell is charged and discharged as the protocol says.
        """

    @abstractmethod
    def await_end(self, duration_s: float) -> Report:
        """Watch a running test, and return once it has finished by itself.

        Effect:
            None by itself.
        """

    @abstractmethod
    def stop_test(self) -> Report:
        """End the test.

        Effect:
            No current flows through the cell.
        """

    @abstractmethod
    def channel_state(self) -> str:
        """Tell what the channel does."""

    @abstractmethod
    def voltage_v(self) -> float:
        """Tell the voltage of the cell."""

    @abstractmethod
    def current_ma(self) -> float:
        """Tell the current through the cell; charging is positive."""

    @abstractmethod
    def cycle_index(self) -> int:
        """Tell the cycle, counted from 1."""
