"""Knauer Azura V 2.1S injection valve.

Protocol: TCP 10001, text lines CR LF; T tells the type, P the position, L and I turn.
Quality: bronze, simulated instrument.
Safe state: the valve stands at a position; a turn that has begun cannot be stopped.

Source:
    Knauer, Azura V 2.1S valve drive, section "Ethernet commands".
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import msgspec

from drivers.base import Driver, Range, Report, action, status
from drivers.connectors._knauer_valve import KnauerDrive
from drivers.connectors._motion import turn_valve
from drivers.interfaces.injection_valve import InjectionValve
from drivers.transports.base import ByteTransport
from labweb.domain.errors import FrameError

LOAD, INJECT = "L", "I"


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One valve at its address."""

    loop_ul: Annotated[float, Range(0.01, 1_000_000.0)] | None = None
    """Volume of the sample loop that is fitted; None: nobody says, and nothing may fill it."""


class KnauerInjectionValve(Driver[ByteTransport, Config], InjectionValve):
    """One valve."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the type, and refuse another valve. Nothing moves."""
        self._drive.identify("LI")

    def halt(self) -> None:
        """Do nothing: the drive cannot be stopped, and ends at a position."""

    @status(every_s=1.0)
    def position(self) -> Literal["load", "inject"]:
        """Tell the position."""
        told = self._drive.position()
        if told not in {LOAD, INJECT}:
            raise FrameError(f"the position is told as {told!r}")
        return "load" if told == LOAD else "inject"

    @action(timeout_s=30.0, recovery="R1")
    def select_position(self, position: Literal["load", "inject"]) -> Report:
        """Turn to a position, and return once the valve stands there.

        Effect:
            The loop's contents come into the way of the other pair of ports.
        """
        self.refuse_if_stopped()
        return turn_valve(
            self,
            position,
            begin=lambda: self._drive.go(LOAD if position == "load" else INJECT),
            is_idle=lambda: self.position() == position,
            where=self.position,
            name="position",
        )

    @property
    def _drive(self) -> KnauerDrive:
        return KnauerDrive(self)
