"""A valve that connects one common port to one of several."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Valve(ABC):
    """A distribution valve with numbered ports."""

    @abstractmethod
    def select_port(self, port_index: int) -> Report:
        """Turn to a port by its number on the valve, and return once the valve stands there.

        Numbers count from 1, unless the maker counts otherwise: then the driver says so.

        Effect:
            None on matter; what flows next flows through that port.
        """

    @abstractmethod
    def port_index(self) -> int | None:
        """Tell the port that is selected, by its number on the valve; None: nobody knows."""
