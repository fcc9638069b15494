"""Vici Valco universal actuator with a two-position valve.

Protocol: RS-232, 9600 8N1, optional id, command, CR; GO is silent, CP tells the position.
Quality: bronze, simulated instrument.
Safe state: the valve stands at a position; a turn that has begun cannot be stopped.

The actuator knows its positions as A and B; how the loop is plumbed says which of them loads.

Source:
    Valco Instruments, Technical Note 415, "Serial commands for the universal electric actuator".
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import msgspec

from drivers.base import Driver, Range, Report, action, status
from drivers.connectors._motion import turn_valve
from drivers.connectors._vici import Actuator
from drivers.interfaces.injection_valve import InjectionValve
from drivers.transports.base import ByteTransport
from labweb.domain.errors import RejectedError


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One actuator on its line."""

    load_position: Literal["A", "B"]
    """Position in which the loop is filled."""

    address: Literal["", "0", "1", "2", "3", "4", "5", "6", "7", "8", "9"] = ""
    """Id of the actuator; "" when it has none."""

    loop_ul: Annotated[float, Range(0.01, 1_000_000.0)] | None = None
    """Volume of the sample loop that is fitted; None: nobody says, and nothing may fill it."""


class ViciInjection(Driver[ByteTransport, Config], InjectionValve):
    """One actuator."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the position, and refuse a multiposition valve. Nothing moves."""
        self.position()

    def halt(self) -> None:
        """Do nothing: the actuator cannot be stopped, and ends at a position."""

    @status(every_s=1.0)
    def position(self) -> Literal["load", "inject"]:
        """Tell the position."""
        told = self._actuator.position()
        if told not in {"A", "B"}:
            raise RejectedError(f"the actuator stands at {told!r}; A or B was expected")
        return "load" if told == self.config.load_position else "inject"

    @action(timeout_s=30.0, recovery="R1")
    def select_position(self, position: Literal["load", "inject"]) -> Report:
        """Turn to a position, and return once the valve stands there.

        Effect:
            The loop's contents come into the way of the other pair of ports.
        """
        self.refuse_if_stopped()
        load = self.config.load_position
        wanted = load if position == "load" else "AB".replace(load, "")
        return turn_valve(
            self,
            position,
            begin=lambda: self._actuator.go(wanted),
            is_idle=lambda: self.position() == position,
            where=self.position,
            name="position",
        )

    @property
    def _actuator(self) -> Actuator:
        return Actuator(self, self.config.address)
