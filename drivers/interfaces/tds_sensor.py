"""A sensor of dissolved solids."""

from __future__ import annotations

from abc import ABC, abstractmethod


class TdsSensor(ABC):
    """A conductivity cell with its own thermometer, which infers the dissolved solids."""

    @abstractmethod
    def tds_ppm(self) -> float:
        """Tell the dissolved solids, in mg/L."""

    @abstractmethod
    def temperature_c(self) -> float:
        """Tell the liquid's temperature."""
