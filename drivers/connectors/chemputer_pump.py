"""Chemputer syringe pump.

Protocol: TCP 5000, text and NUL; a move answers SUCCESS when accepted and DONE when finished.
Quality: bronze, simulated instrument.
Safe state: plunger stands at the end of its move; there is no stop, the pump's watchdog is its own.

The pump does not tell where its plunger stands. The driver keeps count from the last homing; after
a new start, or a move whose end is not known, it has to be initialised again.

Source:
    Cronin group, Chemputer pumps and valves, control software, table of commands.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Accuracy, Driver, Range, Report, action, status
from drivers.connectors._chemputer import ChemputerUnit
from drivers.connectors._motion import limit_of, refuse_rate, refuse_slow_stroke
from drivers.interfaces.pump import Pump
from drivers.transports.base import ByteTransport
from labweb.domain.errors import DeviceError, Effect, PreconditionError

INITIALIZE_S = 120.0
STEP_UL = 1.0
"""Volumes are written in whole microlitres."""

Volume = Annotated[float, Range(1.0, 200_000.0), Accuracy()]
Rate = Annotated[float, Range(0.1, 100_000.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One pump at its address."""

    syringe_ul: Annotated[float, Range(1.0, 200_000.0)]
    """Volume of a full stroke."""

    max_rate_ul_s: Rate
    """Highest rate for this syringe."""

    home_rate_ul_s: Rate
    """Rate at which initialising empties the syringe."""


class ChemputerPump(Driver[ByteTransport, Config], Pump):
    """One pump."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def __init__(self, transport: ByteTransport, config: Mapping[str, Any]) -> None:
        """Hold transport and settings; nothing is opened and nothing is sent."""
        super().__init__(transport, config)
        self._unit = ChemputerUnit(self)
        self._held_ul: int | None = None

    def connect(self) -> None:
        """Open the line and make sure that a pump answers; what it holds is not known then."""
        self._held_ul = None
        super().connect()

    def identify(self) -> None:
        """Ask what answers, and clear the errors that a start leaves. Nothing moves."""
        self._unit.identify("PUMP")

    def halt(self) -> None:
        """Do nothing where nothing moves; a move that runs cannot be stopped."""
        self._unit.halt()

    @status(every_s=2.0)
    def is_initialized(self) -> bool:
        """Tell whether this driver knows where the plunger stands."""
        return self._held_ul is not None

    @status(every_s=0.5)
    def volume_ul(self) -> Annotated[float, Accuracy()] | None:
        """Tell how much the syringe holds, counted from the last homing; None: not known."""
        return None if self._held_ul is None else float(self._held_ul)

    @action(timeout_s=150.0, recovery="R3", hazards=("expels_liquid",), operation="transfer")
    def initialize(self) -> Report:
        """Drive the plunger against its base and find the home position.

        Effect:
            Whatever is in the syringe is pushed out.
            `moved_ul` is None when the volume was unknown before.
        """
        self.refuse_if_stopped()
        before, rate_ul_s = self._held_ul, self.config.home_rate_ul_s
        self._move(f"hard_home {_per_minute(rate_ul_s)}", INITIALIZE_S, 0, before)
        return Report(None if before is None else float(before), {"volume_before_ul": before})

    @action(timeout_s=1860.0, recovery="R3", operation="transfer")
    def aspirate(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Draw liquid in, and return once the pump says that the move is done.

        Effect:
            `moved_ul`, the volume in whole microlitres, into the syringe.
        """
        return self._stroke(volume_ul, rate_ul_s, 1)

    @action(timeout_s=1860.0, recovery="R3", operation="transfer")
    def dispense(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Push liquid out, and return once the pump says that the move is done.

        Effect:
            `moved_ul`, the volume in whole microlitres, out of the syringe.
        """
        return self._stroke(volume_ul, rate_ul_s, -1)

    def _stroke(self, volume_ul: float, rate_ul_s: float, direction: int) -> Report:
        self.refuse_if_stopped()
        refuse_rate(rate_ul_s, 1 / 60, self.config.max_rate_ul_s)
        refuse_slow_stroke(volume_ul / rate_ul_s)
        if self._held_ul is None:
            raise PreconditionError(
                "nobody knows where the plunger stands: initialise the pump",
                code="device.not_initialized",
            )
        before, moved = self._held_ul, round(volume_ul)
        if moved < STEP_UL:
            raise PreconditionError(
                f"{volume_ul:g} µL is less than {STEP_UL:g} µL", code="device.volume_too_small"
            )
        target = before + direction * moved
        if not 0 <= target <= self.config.syringe_ul:
            raise PreconditionError(
                f"the stroke would leave {target} µL in a syringe of {self.config.syringe_ul:g} µL",
                code="device.stroke_out_of_range",
            )
        command = f"move_abs {target} {_per_minute(rate_ul_s)}"
        self._move(command, limit_of(volume_ul / rate_ul_s), target, moved)
        evidence = {"volume_before_ul": before, "volume_after_ul": target}
        return Report(float(moved), evidence, STEP_UL)

    def _move(self, command: str, limit_s: float, target: int, moved_ul: int | None) -> None:
        """Make a move; where its end is not known, neither is the plunger's place."""
        before, self._held_ul = self._held_ul, None
        try:
            self._unit.act(command, limit_s, {"moved_ul": moved_ul})
        except DeviceError as error:
            if error.effect is Effect.NONE:
                self._held_ul = before
            elif error.effect is Effect.PARTIAL:
                self._held_ul = target
            raise
        self._held_ul = target


def _per_minute(rate_ul_s: float) -> int:
    return round(rate_ul_s * 60)
