"""Vici Valco universal actuator with a multiposition valve.

Protocol: RS-232, 9600 8N1, optional id, command, CR; GO is silent, CP tells the position.
Quality: bronze, simulated instrument.
Safe state: the valve stands at a position; a turn that has begun cannot be stopped.

A turn has no answer, so it is watched by the position that the actuator tells.

Source:
    Valco Instruments, Technical Note 415, "Serial commands for the universal electric actuator".
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import msgspec

from drivers.base import Driver, Range, Report, action, status
from drivers.connectors._motion import refuse_port, turn_valve
from drivers.connectors._vici import Actuator
from drivers.interfaces.valve import Valve
from drivers.transports.base import ByteTransport
from labweb.domain.errors import RejectedError


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One actuator on its line."""

    ports_count: Annotated[int, Range(2, 24)]
    """Positions of the valve."""

    address: Literal["", "0", "1", "2", "3", "4", "5", "6", "7", "8", "9"] = ""
    """Id of the actuator; "" when it has none."""


class ViciMultiposition(Driver[ByteTransport, Config], Valve):
    """One actuator."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the position, and refuse a two-position valve. Nothing moves."""
        self.port_index()

    def halt(self) -> None:
        """Do nothing: the actuator cannot be stopped, and ends at a position."""

    @status(every_s=1.0)
    def port_index(self) -> int:
        """Tell the port that is selected, counted from 1."""
        position = self._actuator.position()
        if not position.isdecimal() or not 1 <= int(position) <= self.config.ports_count:
            raise RejectedError(
                f"the actuator stands at {position!r}; "
                f"a valve of {self.config.ports_count} positions was expected"
            )
        return int(position)

    @action(timeout_s=30.0, recovery="R1")
    def select_port(self, port_index: Annotated[int, Range(1, 24)]) -> Report:
        """Turn to a port, counted from 1, and return once the valve stands there.

        Effect:
            None on matter; what flows next flows through that port.
        """
        self.refuse_if_stopped()
        refuse_port(port_index, self.config.ports_count)
        return turn_valve(
            self,
            port_index,
            begin=lambda: self._actuator.go(port_index),
            is_idle=lambda: self.port_index() == port_index,
            where=self.port_index,
        )

    @property
    def _actuator(self) -> Actuator:
        return Actuator(self, self.config.address)
