"""A reader of microplates, with a drawer."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class PlateReader(ABC):
    """Measures each well of the plate in its drawer, and takes nothing of it."""

    @abstractmethod
    def read_absorbance(self, wavelengths_nm: list[int]) -> Report:
        """Read the absorbance of every well, and hand it over as a table; the drawer is shut.

        Effect:
            None on matter: the plate is as it was.
        """

    @abstractmethod
    def open_drawer(self) -> Report:
        """Bring the plate out.

        Effect:
            The plate can be reached.
        """

    @abstractmethod
    def close_drawer(self) -> Report:
        """Take the plate in.

        Effect:
            The plate is inside.
        """

    @abstractmethod
    def is_drawer_open(self) -> bool:
        """Tell whether the drawer is out."""

    @abstractmethod
    def reader_state(self) -> str:
        """Tell what the reader does, in its own words."""
