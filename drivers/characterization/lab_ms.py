"""Mass spectrometer with infusion, by the model data system of this project.

Protocol: HTTP, JSON; `POST /runs` begins a run, its files are fetched once it is done.
Quality: bronze, simulated instrument.
Safe state: nothing is measured; on a lost link a run goes on and its files are stored.

A file counts once its size, the digest that its run tells and the one that comes with its bytes
(`Repr-Digest`) all are those of the bytes.

Source:
    `docs/instruments_analysis.md`, "a data system, HTTP": the interface is a model, no maker's.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, status
from drivers.characterization._data_system import SPARE_S, DataSystem
from drivers.interfaces.analyser import Analyser
from drivers.transports.http import HttpTransport
from labweb.domain.errors import PreconditionError

KIND = "ms"
LEAST_UL, MOST_UL = 1.0, 50.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One instrument."""

    model: str = ""
    """Refuse another model than this; "" accepts any."""

    poll_s: Annotated[float, Range(0.005, 60.0)] = 2.0


class LabMs(Driver[HttpTransport, Config], Analyser):
    """One instrument with its sampler."""

    transport_type: ClassVar[type] = HttpTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def __init__(self, transport: HttpTransport, config: dict[str, Any]) -> None:
        super().__init__(transport, config)
        self._system = DataSystem(self, KIND, lambda: self.config.poll_s)

    def identify(self) -> None:
        """Ask who answers, and refuse another kind or model."""
        self._system.identify(self.config.model)

    def halt(self) -> None:
        """Abort what runs; where nothing does, nothing is sent."""
        self._system.stop()

    @status(every_s=5.0)
    def running_state(self) -> str:
        """Tell what it does: `ready`, `running`, `not_ready`."""
        return self._system.status().state

    @status(every_s=2.0)
    def is_measuring(self) -> bool:
        """Tell whether a measurement of this driver goes on."""
        return bool(self._system.run_id)

    @status(every_s=2.0)
    def progress_ratio(self) -> float:
        """Tell how much of the measurement of this driver is done, 0 to 1."""
        return self._system.progress_ratio

    @action(timeout_s=3600.0, recovery="R3", operation="transfer")
    def measure(
        self,
        vial: str,
        method: str,
        injection_ul: Annotated[float, Range(1.0, 50.0)],
        sample: str,
    ) -> Report:
        """Inject and run a method, and hand its files over once each of them is whole.

        Args:
            vial: Position in the sampler.
            method: `positive` or `negative`, or another that it has.
            injection_ul: What is drawn from the vial.
            sample: Name under which the run is stored.

        Raises:
            PreconditionError: Beyond what the instrument or the method injects (NONE).
            RejectedError: Busy, not ready, no such vial or method (NONE).
            FrameError: A file is damaged; what was injected is gone (PARTIAL).
            DeviceError: The run failed or was stopped: PARTIAL, `moved_ul`, once all was drawn,
                else UNKNOWN; or the link broke, and it may go on (UNKNOWN).

        Effect:
            `injection_ul` is drawn from the vial, and is gone.
        """
        self.refuse_if_stopped()
        if not LEAST_UL <= injection_ul <= MOST_UL:
            raise PreconditionError(
                f"{injection_ul:g} µL were asked for; it injects {LEAST_UL:g} to {MOST_UL:g} µL"
            )
        return self._system.measure(vial, method, injection_ul, sample)

    @action(timeout_s=120.0, recovery="R1")
    def stop_measuring(self) -> Report:
        """End what the instrument measures, and return once it has ended; nothing is stored.

        Effect:
            None by itself: what was injected is gone.
        """
        run_id = self._system.stop()
        if run_id is None:
            return Report(evidence={"run": None})
        ended = self._system.await_end(run_id, SPARE_S)
        return Report(evidence={"run": run_id, "state": ended.state})
