"""Riden RD6006 supply.

Protocol: Modbus RTU, 115200 8N1, functions 3 and 16; set 8 and 9, measured 10 and 11, output 18.
Quality: bronze, simulated instrument; the register map is that of a public driver.
Safe state: output off; on a lost link it goes on.

Voltages are in steps of 10 mV, currents of 1 mA. The RD6006P has finer steps in the same
registers and is refused.

No accuracy is stated: no figure of the maker was found; a unit keeps a calibration that its owner
may set.

Source:
    Registers as the public driver riden-modbus has them.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.power_supply import PowerSupply
from drivers.transports.modbus import RegisterTransport
from drivers.waiting import once_started, refuse_between_steps, refuse_beyond, refuse_untaken
from labweb.domain.errors import DeviceError, RejectedError

MODEL, VOLTAGE_SET, VOLTAGE_OUT, PROTECTION, KEPT, OUTPUT = 0, 8, 10, 16, 17, 18
MODELS = frozenset({60060, 60061, 60062, 60063, 60064})
"""RD6006 and RD6006W; 60065 is the RD6006P."""

TRIPS = {1: "overvoltage", 2: "overcurrent"}
STEP_V, STEP_MA = 0.01, 1.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One supply; its device number stands in the URL."""

    max_voltage_v: Annotated[float, Range(0.0, 60.0)]
    """Highest voltage that this lab allows."""

    max_current_ma: Annotated[float, Range(0.0, 6000.0)]
    """Highest current that this lab allows."""

    settle_s: Annotated[float, Range(0.0, 30.0)] = 0.5
    """Time between turning on and measuring."""


class RidenRd6006(Driver[RegisterTransport, Config], PowerSupply):
    """One supply."""

    transport_type: ClassVar[type] = RegisterTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Read the model's number, and refuse another one."""
        model = self._read(MODEL)
        if model not in MODELS:
            raise RejectedError(
                f"{self.transport.line} answers as model {model}, expected an RD6006",
                context={"model": model},
            )

    def halt(self) -> None:
        """Turn the output off."""
        self.transport.write_registers(OUTPUT, (0,))
        if self._read(OUTPUT) != 0:
            raise DeviceError("the output is still on")

    @status(every_s=1.0)
    def voltage_v(self) -> float:
        """Tell the voltage at the terminals."""
        return self._pair(VOLTAGE_OUT)[0]

    @status(every_s=1.0)
    def current_ma(self) -> float:
        """Tell the current that flows."""
        return self._pair(VOLTAGE_OUT)[1]

    @status(every_s=2.0)
    def voltage_setpoint_v(self) -> float:
        """Tell the wanted voltage."""
        return self._pair(VOLTAGE_SET)[0]

    @status(every_s=2.0)
    def current_setpoint_ma(self) -> float:
        """Tell the limit of current."""
        return self._pair(VOLTAGE_SET)[1]

    @action(timeout_s=60.0, recovery="R1", hazards=("electricity",))
    def supply(
        self,
        voltage_v: Annotated[float, Range(0.0, 60.0)],
        current_ma: Annotated[float, Range(0.0, 6000.0)],
    ) -> Report:
        """Turn the output on with a voltage and a limit of current, and measure both.

        Raises:
            PreconditionError: Beyond the limits of this lab, or between two steps (NONE).
            DeviceError: A setpoint was not taken, a trip, or stopped: the output is off
                again (PARTIAL).

        Effect:
            The output stays on with these setpoints.
        """
        self.refuse_if_stopped()
        refuse_beyond("voltage", voltage_v, 0.0, self.config.max_voltage_v)
        refuse_beyond("current", current_ma, 0.0, self.config.max_current_ma)
        setpoints = (
            refuse_between_steps("voltage", voltage_v, STEP_V),
            refuse_between_steps("current", current_ma, STEP_MA),
        )
        with before_acting():
            self._read(OUTPUT)
        with once_started(self.halt, self._evidence, driver=self):
            self.transport.write_registers(VOLTAGE_SET, setpoints)
            taken_v, taken_ma = self._pair(VOLTAGE_SET)
            refuse_untaken("voltage", taken_v, voltage_v, resolution=STEP_V / 2)
            refuse_untaken("current", taken_ma, current_ma, resolution=STEP_MA / 2)
            self.transport.write_registers(OUTPUT, (1,))
            self.pause(self.config.settle_s)
            self._refuse_trip()
            keeps = "current" if self._read(KEPT) else "voltage"
            return Report(evidence={**self._evidence(), "keeps": keeps})

    @action(timeout_s=30.0, recovery="R1")
    def stop_supply(self) -> Report:
        """Turn the output off.

        Effect:
            No current flows.
        """
        with once_started(self.halt, self._evidence, driver=self):
            self.halt()
            return Report(evidence=self._evidence())

    def _refuse_trip(self) -> None:
        trip = self._read(PROTECTION)
        if trip or not self._read(OUTPUT):
            raise DeviceError(
                f"output is off: {TRIPS.get(trip, 'it did not turn on')}",
                code="device.alarm",
                context={"alarm": trip},
            )

    def _evidence(self) -> dict[str, Any]:
        voltage_v, current_ma = self._pair(VOLTAGE_OUT)
        is_on = self._read(OUTPUT) != 0
        return {"voltage_v": voltage_v, "current_ma": current_ma, "is_on": is_on}

    def _pair(self, address: int) -> tuple[float, float]:
        """Read a voltage in V and the current in mA that follows it."""
        voltage, current = self.transport.read_registers(address, count=2)
        return round(voltage * STEP_V, 2), current * STEP_MA

    def _read(self, address: int) -> int:
        return self.transport.read_registers(address, count=1)[0]
