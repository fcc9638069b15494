"""A stirrer that turns its shaft from above."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Stirrer(ABC):
    """An overhead stirrer. Setpoint and reading are never one field."""

    @abstractmethod
    def stir(self, speed_rpm: float) -> Report:
        """Stir, and return once the speed is reached.

        Effect:
            The motor stays on with this setpoint.
        """

    @abstractmethod
    def stop_stirring(self) -> Report:
        """Turn the motor off, and return once it stands.

        Effect:
            The motor is off.
        """

    @abstractmethod
    def speed_rpm(self) -> float:
        """Tell the motor's reading."""

    @abstractmethod
    def speed_setpoint_rpm(self) -> float:
        """Tell the wanted speed."""

    @abstractmethod
    def torque_ncm(self) -> float:
        """Tell the torque at the shaft."""
