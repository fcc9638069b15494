"""An NMR spectrometer."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal

from drivers.base import Report


class Spectrometer(ABC):
    """Measures the sample in its bore, and takes nothing of it."""

    @abstractmethod
    def measure(
        self,
        sample: str,
        solvent: str,
        scan_count: int,
        acquisition_s: float,
        repetition_s: float,
        pulse_angle_deg: float,
    ) -> Report:
        """Take a proton spectrum, and return once its files are whole; evidence `data_folder`.

        Effect:
            None on matter: the sample is as it was.
        """

    @abstractmethod
    def shim(self, extent: Literal["check", "quick", "power"]) -> Report:
        """Make the field even on the sample that is in, or only check it.

        Effect:
            None on matter.
        """

    @abstractmethod
    def stop_measuring(self) -> Report:
        """End what the spectrometer measures; nothing of it is stored.

        Effect:
            None on matter.
        """

    @abstractmethod
    def is_connected(self) -> bool:
        """Tell whether the control software reaches its spectrometer."""

    @abstractmethod
    def is_measuring(self) -> bool:
        """Tell whether a measurement of this driver goes on."""

    @abstractmethod
    def progress_ratio(self) -> float:
        """Tell how much of the measurement of this driver is done, 0 to 1."""
