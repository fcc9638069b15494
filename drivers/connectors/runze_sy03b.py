"""Runze SY-03B syringe pump with a distribution valve.

Protocol: DT, 9600 or 38400 8N1, `/` address commands `R` CR; answers `/0` status data ETX CR LF.
Quality: bronze, simulated instrument.
Safe state: plunger and valve stand where they are.

Pump and valve share one controller, so one class plays both roles. Every stroke is an
absolute move: the position before and after proves what was moved.

Source:
    Runze, SY-03B user manual, section "DT communication protocol".
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import msgspec

from drivers.base import Accuracy, Driver, Range, Report, action, status
from drivers.connectors._dt import DtPump
from drivers.connectors._motion import SteppedPlunger
from drivers.interfaces.pump import Pump
from drivers.interfaces.valve import Valve
from drivers.transports.base import ByteTransport

STEPS_FULL_COUNT = 6000
"""Steps of a full stroke in mode N0."""

Volume = Annotated[float, Range(0.001, 100_000.0), Accuracy(ratio=0.01)]
"""The maker states 1 % of a full stroke in its data sheet."""
Rate = Annotated[float, Range(0.001, 100_000.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One pump on its line."""

    syringe_ul: Annotated[float, Range(1.0, 100_000.0)]
    """Volume of a full stroke."""

    address: Literal["1", "2", "3", "4", "5", "6", "7", "8", "9", ":", ";", "<", "=", ">", "?"] = (
        "1"
    )
    """Character for the address switch: 0 is "1", 8 is "9", 9 is ":"."""

    ports_count: Annotated[int, Range(2, 12)] = 6
    max_rate_ul_s: Rate | None = None
    """None: as fast as the pump can."""

    init_input_port_index: Annotated[int, Range(1, 12)] | None = None
    """Input port while initialising; None: the pump's own default."""

    init_output_port_index: Annotated[int, Range(1, 12)] | None = None
    """Port through which initialising empties the syringe; None: the pump's own default."""

    firmware: str = ""
    """What the firmware's answer must contain; "" accepts any."""

    def __post_init__(self) -> None:
        """Refuse half a choice: the pump takes both initialisation ports or none."""
        if (self.init_input_port_index is None) != (self.init_output_port_index is None):
            raise ValueError("set both init_input_port_index and init_output_port_index, or none")


class RunzeSy03b(Driver[ByteTransport, Config], Pump, Valve):
    """One pump and its valve at one address of the line."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for status, initialised flag and firmware. Nothing moves."""
        self._pump.identify(self.config.firmware)

    def halt(self) -> None:
        """Terminate plunger and valve moves."""
        self._pump.halt()

    @status(every_s=2.0)
    def is_initialized(self) -> bool:
        """Tell whether the plunger's zero is known."""
        return self._pump.knows_position()

    @status(every_s=0.5)
    def volume_ul(self) -> Annotated[float, Accuracy(ratio=0.01)]:
        """Tell how much the syringe holds, from the plunger's position."""
        return self._plunger.volume_ul(self._pump.position())

    @status(every_s=1.0)
    def port_index(self) -> int:
        """Tell the port that is selected, counted from 1."""
        return self._pump.port_index()

    @action(timeout_s=90.0, recovery="R2", hazards=("expels_liquid",), operation="transfer")
    def initialize(self) -> Report:
        """Find the plunger's zero.

        Effect:
            Whatever is in the syringe is pushed out of the initialisation port.
            `moved_ul` is None when the zero was unknown before.
        """
        ports = (self.config.init_input_port_index, self.config.init_output_port_index)
        return self._pump.initialize("Z" if None in ports else f"Z0,{ports[0]},{ports[1]}")

    @action(timeout_s=1260.0, recovery="R2", operation="transfer")
    def aspirate(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Draw liquid in through the selected port, and return once the plunger stands.

        Effect:
            `moved_ul`, the volume in whole steps, from the port into the syringe.
        """
        return self._pump.stroke(volume_ul, rate_ul_s, self.config.max_rate_ul_s, 1)

    @action(timeout_s=1260.0, recovery="R2", operation="transfer")
    def dispense(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Push liquid out through the selected port, and return once the plunger stands.

        Effect:
            `moved_ul`, the volume in whole steps, from the syringe out of the port.
        """
        return self._pump.stroke(volume_ul, rate_ul_s, self.config.max_rate_ul_s, -1)

    @action(timeout_s=30.0, recovery="R1")
    def select_port(self, port_index: Annotated[int, Range(1, 12)]) -> Report:
        """Turn to a port, counted from 1, and return once the valve stands there.

        Effect:
            None on matter; what flows next flows through that port.
        """
        return self._pump.select_port(port_index, self.config.ports_count)

    @property
    def _plunger(self) -> SteppedPlunger:
        return SteppedPlunger(self.config.syringe_ul, STEPS_FULL_COUNT)

    @property
    def _pump(self) -> DtPump:
        return DtPump(self, self.config.address, self._plunger)
