"""A potentiostat with one cell of three electrodes."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.base import Report


class Potentiostat(ABC):
    """Measures at its cell; between two measurements the cell is off, and no current flows.

    Potentials are those of the working electrode against the reference; an anodic current is
    positive. Each measurement hands its points over as a table with units.
    """

    @abstractmethod
    def measure_open_circuit(self, duration_s: float, interval_s: float) -> Report:
        """Read the potential of the open cell, every so often; evidence `last_potential_v`.

        Effect:
            None on matter: no current flows.
        """

    @abstractmethod
    def hold_potential(self, potential_v: float, duration_s: float, interval_s: float) -> Report:
        """Hold a potential and read the current (chronoamperometry), then turn the cell off.

        Effect:
            What stands in the cell is oxidised or reduced by the charge that flowed.
        """

    @abstractmethod
    def sweep_linear(self, first_v: float, last_v: float, step_v: float, rate_v_s: float) -> Report:
        """Sweep the potential once and read the current (LSV), then turn the cell off.

        Effect:
            What stands in the cell is oxidised or reduced by the charge that flowed.
        """

    @abstractmethod
    def sweep_cyclic(
        self,
        first_v: float,
        vertex_1_v: float,
        vertex_2_v: float,
        step_v: float,
        rate_v_s: float,
        cycles_count: int,
    ) -> Report:
        """Sweep from the first potential over both vertices and back (CV), then cell off.

        Effect:
            What stands in the cell is oxidised or reduced by the charge that flowed.
        """

    @abstractmethod
    def stop_measuring(self) -> Report:
        """End what is measured and turn the cell off; nothing of it is stored.

        Effect:
            No current flows through the cell.
        """

    @abstractmethod
    def is_connected(self) -> bool:
        """Tell whether the instrument that was found at first still answers."""

    @abstractmethod
    def is_measuring(self) -> bool:
        """Tell whether a measurement of this driver goes on."""

    @abstractmethod
    def progress_ratio(self) -> float:
        """Tell how much of the measurement of this driver is done, 0 to 1."""

    @abstractmethod
    def potential_v(self) -> float | None:
        """Tell the potential of the last point of this driver; None: it has measured none."""

    @abstractmethod
    def current_ma(self) -> float | None:
        """Tell the current of the last point of this driver; None: it has measured none."""
