"""A vehicle that drives by itself between stations that are named."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Agv(ABC):
    """An autonomous vehicle. It knows its map; what stands on it goes with it."""

    @abstractmethod
    def drive_to(self, station: str) -> Report:
        """Drive to a station, and return once the vehicle stands there.

        Effect:
            Vehicle and all that it carries are at the station.
        """

    @abstractmethod
    def stop_driving(self) -> Report:
        """Give the order up; the vehicle stands where it is.

        Effect:
            The vehicle stands; what it carries it still carries.
        """

    @abstractmethod
    def station(self) -> str:
        """Tell the station at which it stands, "" between two."""

    @abstractmethod
    def is_driving(self) -> bool:
        """Tell whether it is under way, or waits to go on."""

    @abstractmethod
    def x_mm(self) -> float:
        """Tell where it is on its map, to the right."""

    @abstractmethod
    def y_mm(self) -> float:
        """Tell where it is on its map, to the back."""

    @abstractmethod
    def confidence_ratio(self) -> float:
        """Tell how sure it is of its place: 1 for certain."""
