"""Runze SV-06 distribution valve.

Protocol: Runze binary, 57600 or 9600 8N1, eight bytes from CC, DD before the 16-bit sum.
Quality: bronze, simulated instrument.
Safe state: the valve stands where it is.

Source:
    Runze, SV-06 manual, section "Communication protocol".
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, status
from drivers.connectors._motion import VALVE_S, refuse_port, turn_valve
from drivers.connectors._runze import VALVE_POSITION, VALVE_TO, RunzeUnit
from drivers.interfaces.valve import Valve
from drivers.transports.base import ByteTransport


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One valve on its line."""

    address_index: Annotated[int, Range(0, 127)] = 0

    ports_count: Annotated[int, Range(2, 16)]
    """Ports of the head that is fitted, without the common one."""


class RunzeSv06(Driver[ByteTransport, Config], Valve):
    """One valve at one address of the line."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the address. Nothing moves."""
        self._unit.identify()

    def halt(self) -> None:
        """Stop the valve where it is."""
        self._unit.halt()

    @status(every_s=1.0)
    def port_index(self) -> int:
        """Tell the port that is selected, counted from 1."""
        return self._unit.ask(VALVE_POSITION)

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
            begin=lambda: self._unit.act(VALVE_TO, port_index, VALVE_S),
            is_idle=self._unit.is_idle,
            where=self.port_index,
        )

    @property
    def _unit(self) -> RunzeUnit:
        return RunzeUnit(self, self.config.address_index)
