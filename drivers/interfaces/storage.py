"""A store of plates with a handler and a transfer station."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Storage(ABC):
    """Numbered places inside, one transfer station outside."""

    @abstractmethod
    def initialize(self) -> Report:
        """Find the zero of the handler.

        Effect:
            The handler moves to its waiting place; it must not carry a plate.
        """

    @abstractmethod
    def store_plate(self, slot_index: int) -> Report:
        """Take the plate from the transfer station to a place, counted from 1.

        Effect:
            The plate has moved from the transfer station to the place.
        """

    @abstractmethod
    def retrieve_plate(self, slot_index: int) -> Report:
        """Bring the plate from a place, counted from 1, to the transfer station.

        Effect:
            The plate has moved from the place to the transfer station.
        """

    @abstractmethod
    def is_ready(self) -> bool:
        """Tell whether the handler is initialised and has nothing to do."""

    @abstractmethod
    def has_plate_at_transfer(self) -> bool:
        """Tell whether the transfer station is occupied."""

    @abstractmethod
    def temperature_c(self) -> float:
        """Tell the temperature of the chamber."""
