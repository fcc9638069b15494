"""Runze SY-01 syringe pump with a distribution valve.

Protocol: Runze binary, 57600 or 9600 8N1, eight bytes from CC, DD before the 16-bit sum.
Quality: bronze, simulated instrument.
Safe state: plunger and valve stand where they are.

The published commands set no speed, so the pump has one rate: that of its own setting, which
`full_stroke_s` tells. A stroke at another rate is refused. Moves are relative; the position before
and after proves what was moved. Nor do they tell where the valve of a pump stands, so the driver
keeps the port of the last turn that the motor ended, and that it had the zero found; before both no
stroke is made.

Source:
    Runze, SY-01 manual, section "Communication protocol".
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import msgspec

from drivers.base import (
    Accuracy,
    Driver,
    Range,
    Report,
    action,
    after_acting,
    before_acting,
    status,
)
from drivers.connectors._motion import (
    VALVE_S,
    SteppedPlunger,
    limit_of,
    refuse_port,
    refuse_rate,
    run_stroke,
    watch,
)
from drivers.connectors._runze import (
    ASPIRATE,
    DISPENSE,
    DONE,
    HOME,
    PLUNGER_POSITION,
    UNKNOWN_POSITION,
    VALVE_TO,
    RunzeUnit,
    describe,
)
from drivers.interfaces.pump import Pump
from drivers.interfaces.valve import Valve
from drivers.transports.base import ByteTransport
from labweb.domain.errors import DeviceError, Effect, PreconditionError, RejectedError

STEPS_FULL_COUNT = 12_000
INITIALIZE_S = 60.0
RATE_TOLERANCE_RATIO = 0.05
"""How far the rate that is asked for may lie from the pump's own."""

Volume = Annotated[float, Range(0.001, 100_000.0), Accuracy()]
Rate = Annotated[float, Range(0.001, 100_000.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One pump on its line."""

    syringe_ul: Annotated[float, Range(1.0, 100_000.0)]
    """Volume of a full stroke."""

    full_stroke_s: Annotated[float, Range(0.1, 1200.0)]
    """Time of a full stroke at the speed that is set in the pump: measure it once."""

    ports_count: Annotated[int, Range(2, 16)]
    """Ports of the head that is fitted, without the common one."""

    address_index: Annotated[int, Range(0, 127)] = 0


class RunzeSy01(Driver[ByteTransport, Config], Pump, Valve):
    """One pump and its valve at one address of the line."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    _port_index: int | None = None
    _has_zero = False

    def connect(self) -> None:
        """Open the line and make sure that the pump answers; where its parts stand is open."""
        self._port_index, self._has_zero = None, False
        super().connect()

    def identify(self) -> None:
        """Ask for the address. Nothing moves."""
        self._unit.identify()

    def halt(self) -> None:
        """Stop plunger and valve where they are."""
        self._unit.halt()

    @status(every_s=2.0)
    def is_initialized(self) -> bool:
        """Tell whether this driver had the zero found, and the pump still has a position."""
        reply = self._unit.exchange(PLUNGER_POSITION)
        if reply.status not in {DONE, UNKNOWN_POSITION}:
            raise RejectedError(f"the pump reports {describe(reply.status)}")
        return self._has_zero and reply.status == DONE

    @status(every_s=0.5)
    def volume_ul(self) -> Annotated[float, Accuracy()]:
        """Tell how much the syringe holds, from the plunger's position."""
        return self._plunger.volume_ul(self.position())

    @status(every_s=1.0)
    def port_index(self) -> int | None:
        """Tell the port of the last turn that the motor ended, counted from 1; None: not known."""
        return self._port_index

    @action(timeout_s=150.0, recovery="R2", hazards=("expels_liquid",), operation="transfer")
    def initialize(self) -> Report:
        """Find the plunger's zero.

        Effect:
            Whatever is in the syringe is pushed out of the selected port.
            `moved_ul` is None when the zero was unknown before.
        """
        self.refuse_if_stopped()
        with before_acting():
            before = self.position() if self.is_initialized() else None
        self._has_zero = False
        self._unit.act(HOME, 0, INITIALIZE_S)
        with after_acting():
            watch(self, self.is_idle, INITIALIZE_S)
            after = self.position()
        self._has_zero = True
        moved_ul = None if before is None else self._plunger.volume_ul(before - after)
        return Report(moved_ul, {"steps_before": before, "steps_after": after})

    @action(timeout_s=1860.0, recovery="R2", operation="transfer")
    def aspirate(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Draw liquid in through the selected port, and return once the plunger stands.

        Effect:
            `moved_ul`, the volume in whole steps, from the port into the syringe.
        """
        return self._stroke(volume_ul, rate_ul_s, ASPIRATE)

    @action(timeout_s=1860.0, recovery="R2", operation="transfer")
    def dispense(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Push liquid out through the selected port, and return once the plunger stands.

        Effect:
            `moved_ul`, the volume in whole steps, from the syringe out of the port.
        """
        return self._stroke(volume_ul, rate_ul_s, DISPENSE)

    @action(timeout_s=30.0, recovery="R1")
    def select_port(self, port_index: Annotated[int, Range(1, 16)]) -> Report:
        """Turn to a port, counted from 1, and return once the valve stands there.

        Effect:
            None on matter; what flows next flows through that port.
        """
        self.refuse_if_stopped()
        refuse_port(port_index, self.config.ports_count)
        before, self._port_index = self._port_index, None
        try:
            self._unit.act(VALVE_TO, port_index, VALVE_S)
            with after_acting():
                watch(self, self.is_idle, VALVE_S)
        except DeviceError as error:
            self._port_index = before if error.effect is Effect.NONE else None
            raise
        self._port_index = port_index
        return Report(evidence={"port_index": port_index})

    def position(self) -> int:
        """Return the plunger's step."""
        return self._unit.ask(PLUNGER_POSITION)

    def is_idle(self) -> bool:
        """Tell whether the motor stands."""
        return self._unit.is_idle()

    def knows_position(self) -> bool:
        """Tell whether the position can be trusted: only a stop from here is known to keep it."""
        return self._has_zero and self.is_stopped

    def _stroke(self, volume_ul: float, rate_ul_s: float, function: int) -> Report:
        self.refuse_if_stopped()
        own_ul_s = self.config.syringe_ul / self.config.full_stroke_s
        leeway_ul_s = own_ul_s * RATE_TOLERANCE_RATIO
        refuse_rate(rate_ul_s, own_ul_s - leeway_ul_s, own_ul_s + leeway_ul_s)
        steps = self._plunger.steps(volume_ul)
        if not self._has_zero or self._port_index is None:
            raise PreconditionError(
                "nobody knows where plunger and valve stand: initialise and select a port",
                code="device.not_initialized",
            )
        speed = STEPS_FULL_COUNT / self.config.full_stroke_s
        try:
            return run_stroke(
                self,
                self._plunger,
                self,
                steps=steps if function == ASPIRATE else -steps,
                speed_steps_s=speed,
                begin=lambda _: self._unit.act(function, steps, limit_of(steps / speed)),
            )
        except DeviceError as error:
            self._has_zero = error.effect is not Effect.UNKNOWN
            raise

    @property
    def _plunger(self) -> SteppedPlunger:
        return SteppedPlunger(self.config.syringe_ul, STEPS_FULL_COUNT)

    @property
    def _unit(self) -> RunzeUnit:
        return RunzeUnit(self, self.config.address_index)
