"""A flash chromatography system: solvents, an injection valve, a column, a fraction collector."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal

from drivers.base import Report


class Chromatography(ABC):
    """Up to four solvent lines go over one column. What leaves it, the collector takes."""

    @abstractmethod
    def start_flow(
        self,
        rate_ul_s: float,
        line_1_ratio: float,
        line_2_ratio: float,
        line_3_ratio: float,
        line_4_ratio: float,
    ) -> Report:
        """Pump a mixture of the solvent lines, and return once it flows.

        Effect:
            Solvent goes over the column until it is stopped, or its bottle is empty.
        """

    @abstractmethod
    def stop_flow(self) -> Report:
        """Stop the pump.

        Effect:
            No solvent flows.
        """

    @abstractmethod
    def select_position(self, position: Literal["load", "separation"]) -> Report:
        """Turn the injection valve to `load` or to `separation`.

        Effect:
            In `separation` the flow takes what was loaded onto the column.
        """

    @abstractmethod
    def collect(self, target: Literal["waste", "vial"]) -> Report:
        """Lead what leaves the column to `waste`, or to the next `vial`.

        Effect:
            From now on it goes there.
        """

    @abstractmethod
    def is_running(self) -> bool:
        """Tell whether solvent flows."""

    @abstractmethod
    def rate_setpoint_ul_s(self) -> float:
        """Tell the wanted rate."""

    @abstractmethod
    def pressure_kpa(self) -> float:
        """Tell the pressure behind the pump."""

    @abstractmethod
    def position(self) -> str:
        """Tell where the injection valve stands."""

    @abstractmethod
    def collects_to(self) -> str:
        """Tell where what leaves the column goes."""

    @abstractmethod
    def running_state(self) -> str:
        """Tell what the system does by its own program, in its maker's words."""
