"""Knauer Azura V 2.1S multiposition valve.

Protocol: TCP 10001, text lines CR LF; T tells the type, P the position, a number turns.
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
from drivers.connectors._motion import refuse_port, turn_valve
from drivers.interfaces.valve import Valve
from drivers.transports.base import ByteTransport
from labweb.domain.errors import FrameError


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One valve at its address."""

    ports_count: Literal[6, 12, 16]
    """Positions of the valve; the drive has to confirm them."""


class KnauerValve(Driver[ByteTransport, Config], Valve):
    """One valve."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the type, and refuse another valve. Nothing moves."""
        self._drive.identify(str(self.config.ports_count))

    def halt(self) -> None:
        """Do nothing: the drive cannot be stopped, and ends at a position."""

    @status(every_s=1.0)
    def port_index(self) -> int:
        """Tell the port that is selected, counted from 1."""
        position = self._drive.position()
        if not position.isdecimal() or not 1 <= int(position) <= self.config.ports_count:
            raise FrameError(f"the position is told as {position!r}")
        return int(position)

    @action(timeout_s=30.0, recovery="R1")
    def select_port(self, port_index: Annotated[int, Range(1, 16)]) -> Report:
        """Turn to a port, counted from 1, and return once the valve stands there.

        Effect:
            None on matter; what flows next flows through that port.
        """
        self.refuse_if_stopped()
        refuse_port(port_index, self.config.ports_count)
        return turn_valve(
            self,
            port_index,
            begin=lambda: self._drive.go(port_index),
            is_idle=lambda: self.port_index() == port_index,
            where=self.port_index,
        )

    @property
    def _drive(self) -> KnauerDrive:
        return KnauerDrive(self)
