"""Chemputer selection valve.

Protocol: TCP 5000, text and NUL; a move answers SUCCESS when accepted and DONE when finished.
Quality: bronze, simulated instrument.
Safe state: the valve stands at a position; a turn that has begun cannot be stopped.

The valve does not tell where it stands, so the driver keeps the last position that was done. Its
ports are numbered 0 to 5 on the valve and in graphs of Chemputers; -1 is the common one. A lab
that counts them from 1 says so in the settings.

Source:
    Cronin group, Chemputer pumps and valves, control software, table of commands.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, status
from drivers.connectors._chemputer import ChemputerUnit
from drivers.connectors._motion import VALVE_S
from drivers.interfaces.valve import Valve
from drivers.transports.base import ByteTransport
from labweb.domain.errors import DeviceError, Effect, PreconditionError

LAST_PORT = 5


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One valve at its address."""

    first_port_index: Annotated[int, Range(0, 1)] = 0
    """What the lab calls the port that is 0 on the valve: a lab that counts from 1 sets 1."""


class ChemputerValve(Driver[ByteTransport, Config], Valve):
    """One valve."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def __init__(self, transport: ByteTransport, config: Mapping[str, Any]) -> None:
        """Hold transport and settings; nothing is opened and nothing is sent."""
        super().__init__(transport, config)
        self._unit = ChemputerUnit(self)
        self._port_index: int | None = None

    def connect(self) -> None:
        """Open the line and make sure that a valve answers; where it stands is not known then."""
        self._port_index = None
        super().connect()

    def identify(self) -> None:
        """Ask what answers, and clear the errors that a start leaves. Nothing moves."""
        self._unit.identify("VALVE")

    def halt(self) -> None:
        """Do nothing where nothing moves; a turn that runs cannot be stopped."""
        self._unit.halt()

    @status(every_s=2.0)
    def has_error(self) -> bool:
        """Ask whether the valve reports an error; it shows that the valve still answers."""
        return self._unit.errors() != 0

    @status(every_s=1.0)
    def port_index(self) -> int | None:
        """Tell the port of the last turn that was done, as the lab counts; None: not known."""
        return self._port_index

    @action(timeout_s=30.0, recovery="R1")
    def select_port(self, port_index: Annotated[int, Range(0, 6)]) -> Report:
        """Turn to a port, counted from `first_port_index`, and return once the turn is done.

        Effect:
            None on matter; what flows next flows through that port.
        """
        self.refuse_if_stopped()
        first = self.config.first_port_index
        if not 0 <= port_index - first <= LAST_PORT:
            raise PreconditionError(
                f"port {port_index} was asked for; the valve has {first} to {first + LAST_PORT}",
                code="device.no_port",
            )
        before, self._port_index = self._port_index, None
        stands = {"moved_ul": 0.0, "port_index": port_index}
        try:
            self._unit.act(f"pos {port_index - first}", VALVE_S, stands)
        except DeviceError as error:
            if error.effect is not Effect.UNKNOWN:
                self._port_index = before if error.effect is Effect.NONE else port_index
            raise
        self._port_index = port_index
        return Report(evidence={"port_index": port_index})
