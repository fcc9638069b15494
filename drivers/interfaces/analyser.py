"""An instrument that draws from a vial, runs a method, and writes a file: HPLC, GC-MS, MS."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Analyser(ABC):
    """Injects from one of its vials. What it has drawn does not come back."""

    @abstractmethod
    def measure(self, vial: str, method: str, injection_ul: float, sample: str) -> Report:
        """Inject and run a method, and hand its files over once each of them is whole.

        Effect:
            `injection_ul` is drawn from the vial, and is gone.
        """

    @abstractmethod
    def stop_measuring(self) -> Report:
        """End what the instrument measures, and return once it has ended; nothing is stored.

        Effect:
            None by itself: what was injected is gone.
        """

    @abstractmethod
    def running_state(self) -> str:
        """Tell what it does, in its own words: `ready`, `running`, `not_ready`."""

    @abstractmethod
    def is_measuring(self) -> bool:
        """Tell whether a measurement of this driver goes on."""

    @abstractmethod
    def progress_ratio(self) -> float:
        """Tell how much of the measurement of this driver is done, 0 to 1."""
