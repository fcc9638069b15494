"""Tube or chamber furnace behind an S7-1200 or S7-1500 controller.

Protocol: S7 over ISO on TCP, PUT/GET allowed; one data block of 48 bytes, big-endian, version 1.
Quality: bronze, simulated instrument.
Safe state: heater off; on a lost link the controller's watchdog turns it off.

Each start has an order number, which the controller gives back once it has taken the start: that a
start was taken is read and not assumed. While the line is open the life counter goes up, so that
the watchdog, which every start sets, sees that somebody is there.

No accuracy is stated: the table is that of a controller's program; thermocouple and input module
decide.

Source:
    Table of the data block "remote", version 1, that the controller's program has: byte, type, name
    and access of each field, status bits and error numbers.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import (
    Driver,
    Quantity,
    Range,
    Report,
    action,
    before_acting,
    status,
)
from drivers.interfaces.furnace import Furnace
from drivers.processing._s7_block import (
    ACKNOWLEDGE,
    BLOCK_BYTES,
    COMMANDS,
    DOOR_OPEN,
    ERRORS,
    LIFE,
    ORDER,
    ORDERS,
    REMOTE,
    START,
    STOP,
    TARGET,
    VERSION,
    FurnaceState,
    decode_block,
    encode_setpoint,
)
from drivers.transports.s7.transport import S7Transport
from drivers.waiting import TemperatureControl, once_started, refuse_beyond, refuse_untaken
from labweb.domain.errors import DeviceError, RejectedError

RESOLUTION_C, RESOLUTION_K_MIN = 0.01, 0.001
BEATS = 3
"""Counts of the life counter in the time of the watchdog."""

TAKEN_S = 5.0
"""Longest time until the controller has taken a command."""

LOOK_S = 0.05

Temperature = Annotated[float, Range(0.0, 3000.0)]
Tolerance = Annotated[float, Range(0.1, 50.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One furnace."""

    block_index: Annotated[int, Range(1, 65_535)] = 10
    """Number of the data block."""

    max_temperature_c: Temperature
    """Highest temperature that this lab allows."""

    max_ramp_k_min: Annotated[float, Range(0.0, 1000.0)]
    """Steepest ramp that tube and charge stand; 0 allows the furnace to go as fast as it can."""

    watchdog_s: Annotated[int, Range(3, 3600)] = 30
    """After this time without a sign of life the controller turns the heater off."""

    reach_limit_s: Annotated[float, Range(0.1, 170_000.0)] = 86_400.0
    """Longest time to reach a temperature."""

    settle_s: Annotated[float, Range(0.0, 3600.0)] = 10.0
    """How long the reading must stay within tolerance."""

    grace_s: Annotated[float, Range(0.0, 600.0)] = 30.0
    """How long a held temperature may leave its tolerance."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 1.0


class S7Furnace(Driver[S7Transport, Config], Furnace):
    """One furnace."""

    transport_type: ClassVar[type] = S7Transport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Read the block and refuse another version of it; from here on the life counter goes up.

        Raises:
            RejectedError: There is no such block, or its version is another.
        """
        state = self._state()
        if state.version != VERSION:
            raise RejectedError(
                f"block {self.config.block_index} has version {state.version}, expected {VERSION}",
                context={"version": state.version},
            )
        every_s = self.config.watchdog_s / BEATS / self.pace
        self.transport.keep_alive(self.config.block_index, LIFE, every_s)

    def halt(self) -> None:
        """Turn the heater off, and see that it is.

        Raises:
            DeviceError: The control is still on.
        """
        self._command(STOP)
        deadline_s = time.monotonic() + TAKEN_S
        while self._state().is_on:
            if time.monotonic() > deadline_s:
                raise DeviceError("the control is on after a stop", code="device.slow")
            self.rest(LOOK_S)

    @status(every_s=2.0)
    def temperature_c(self) -> float:
        """Tell the reading.

        Raises:
            DeviceError: The thermocouple is broken.
        """
        return self._reading(self._state())

    @status(every_s=4.0)
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature, at the end of the ramp."""
        return self._state().target_c

    @status(every_s=2.0)
    def is_heating(self) -> bool:
        """Tell whether the control is on."""
        return self._state().is_on

    @status(every_s=2.0)
    def is_door_open(self) -> bool:
        """Tell whether the door is open."""
        return bool(self._state().bits & DOOR_OPEN)

    @action(timeout_s=172_800.0, recovery="R1", hazards=("heat",))
    def ramp_to(
        self,
        temperature_c: Temperature,
        ramp_k_min: Annotated[float, Range(0.0, 1000.0)],
        tolerance_c: Tolerance,
    ) -> Report:
        """Follow a ramp to a temperature, and return once the reading has stayed near it.

        Args:
            temperature_c: Setpoint.
            ramp_k_min: How steep; 0: as fast as it can, where the lab allows that.
            tolerance_c: How near.

        Raises:
            PreconditionError: Beyond the limits of this lab or of the furnace (NONE).
            RejectedError: Not in remote, door open, or an alarm that nobody has seen (NONE).
            DeviceError: Not reached in time, an alarm, or stopped: the heater is off again, and
                `context["temperature_c"]` says how far it came (PARTIAL); after a lost answer
                UNKNOWN.

        Effect:
            The control stays on with this setpoint.
        """
        steepest = self.config.max_ramp_k_min
        if steepest:
            refuse_beyond("ramp", ramp_k_min, RESOLUTION_K_MIN, steepest)
        self._check_start(temperature_c)
        return self._control(ramp_k_min).reach(temperature_c, tolerance_c)

    @action(timeout_s=604_800.0, recovery="R3", hazards=("heat",))
    def hold(
        self,
        duration_s: Annotated[float, Range(0.0, 600_000.0)],
        temperature_c: Temperature,
        tolerance_c: Tolerance,
    ) -> Report:
        """Keep a temperature that is already reached for a while, and watch it.

        After a crash nobody can tell how long it was kept: a person decides.

        Raises:
            PreconditionError: Beyond the limits, or the reading is not within tolerance at the
                start (NONE).
            RejectedError: Not in remote, door open, or an alarm that nobody has seen (NONE).
            DeviceError: It left the tolerance for longer than the grace time, an alarm, or
                stopped: the heater is off, and `context["held_s"]` says after how long (PARTIAL).

        Effect:
            The control stays on with this setpoint.
        """
        reading_c = self._check_start(temperature_c)
        control = self._control(self.config.max_ramp_k_min)
        return control.hold(reading_c, duration_s, temperature_c, tolerance_c)

    @action(timeout_s=30.0, recovery="R1")
    def stop_heating(self) -> Report:
        """Turn the heater off; the furnace cools by itself.

        Effect:
            The heater is off.
        """
        with once_started(self.halt, self._temperatures, driver=self):
            self.halt()
            return Report(evidence=self._temperatures())

    @action(timeout_s=30.0, recovery="R1")
    def acknowledge_alarm(self) -> Report:
        """Tell the furnace that its alarm was seen; it stays off.

        Raises:
            RejectedError: Its reason is still there (NONE).

        Effect:
            None on matter: the next start is not refused for this alarm.
        """
        self.refuse_if_stopped()
        with before_acting():
            self._command(ACKNOWLEDGE)
            state = self._await_command(ACKNOWLEDGE)
            if state.alarm:
                raise RejectedError(
                    f"the alarm stays: {state.alarm} (error {state.error})",
                    context={"alarm": state.error},
                )
            return Report(evidence=self._temperatures())

    def _control(self, ramp_k_min: float) -> TemperatureControl:
        return TemperatureControl(
            driver=self,
            read=self._reading_under_control,
            before=lambda temperature_c: self._start(temperature_c, ramp_k_min),
            begin=self._refuse_other_target,
            end=self.halt,
            describe=self._temperatures,
        )

    def _check_start(self, temperature_c: float) -> float:
        """Return the reading before anything is sent that acts."""
        self.refuse_if_stopped()
        refuse_beyond("temperature", temperature_c, 0.0, self.config.max_temperature_c)
        with before_acting():
            state = self._state()
            refuse_beyond("temperature", temperature_c, state.low_c, state.high_c)
            reasons = {
                "not released for remote control: turn its key switch": not state.bits & REMOTE,
                "open: close its door": bool(state.bits & DOOR_OPEN),
                f"in alarm, {state.alarm}: see to it and acknowledge it": bool(state.alarm),
            }
            if found := [reason for reason, holds in reasons.items() if holds]:
                raise RejectedError(
                    f"the furnace is {'; it is '.join(found)}", context={"alarm": state.error}
                )
            return self._reading(state)

    def _start(self, temperature_c: float, ramp_k_min: float) -> None:
        """Write the setpoint and start with an order number of its own.

        Raises:
            RejectedError: The controller refused the start, and the heater is off (NONE).
            DeviceError: NONE while the heater was off and nothing was started; else it was
                tried to turn it off (UNKNOWN).
        """
        with before_acting():
            state = self._state()
        order = state.order_taken % ORDERS + 1
        setpoint = encode_setpoint(temperature_c, ramp_k_min, self.config.watchdog_s)
        with self._acting() if state.is_on else before_acting():
            self._write(TARGET, setpoint)
            self._write(ORDER, order.to_bytes(2, "big"))
            self._refuse_untaken(temperature_c, ramp_k_min, order)
        with self._acting():
            self._command(START)
            state = self._await_order(order)
        if state.order_taken != order:
            why = state.alarm or "it does not say why"
            if state.is_on:
                with self._acting():
                    raise DeviceError(f"a start while it was on was not taken: {why}")
            raise RejectedError(f"the furnace did not start: {why}", context={"alarm": state.error})

    @contextmanager
    def _acting(self) -> Iterator[None]:
        """Turn the heater off where what was begun did not succeed."""
        with once_started(self.halt, self._temperatures, driver=self):
            yield

    def _refuse_untaken(self, temperature_c: float, ramp_k_min: float, order: int) -> None:
        state = self._state()
        refuse_untaken("target", state.target_c, temperature_c, resolution=RESOLUTION_C)
        refuse_untaken("ramp", state.ramp_k_min, ramp_k_min, resolution=RESOLUTION_K_MIN)
        refuse_untaken("watchdog", state.watchdog_s, self.config.watchdog_s, resolution=0)
        refuse_untaken("order", state.order, order, resolution=0)

    def _await_order(self, order: int) -> FurnaceState:
        """Return the state once the start is taken, refused, or neither for too long."""
        deadline_s = time.monotonic() + TAKEN_S
        while True:
            state = self._state()
            if state.order_taken == order or state.alarm or time.monotonic() > deadline_s:
                return state
            self.pause(LOOK_S)

    def _await_command(self, command: int) -> FurnaceState:
        """Return the state once the controller has taken a command."""
        deadline_s = time.monotonic() + TAKEN_S
        while (state := self._state()).commands & command:
            if time.monotonic() > deadline_s:
                raise DeviceError("the controller takes no command", code="device.slow")
            self.rest(LOOK_S)
        return state

    def _refuse_other_target(self, temperature_c: float) -> None:
        refuse_untaken("target", self._state().target_c, temperature_c, resolution=RESOLUTION_C)

    def _reading_under_control(self) -> float:
        state = self._state()
        if state.alarm or not state.is_on:
            self.pause(0)  # a stop from another thread is told as such
            raise DeviceError(
                f"the furnace went off by itself: {state.alarm or 'it does not say why'}",
                code="device.alarm",
                context={"alarm": state.error},
            )
        return self._reading(state)

    def _reading(self, state: FurnaceState) -> float:
        if state.error == 1:
            raise DeviceError(
                f"no reading: {ERRORS[1]}", code="device.alarm", context={"alarm": state.error}
            )
        return state.reading_c

    def _temperatures(self) -> dict[str, Any]:
        state = self._state()
        return {
            "temperature_c": self._reading(state),
            "temperature_setpoint_c": state.target_c,
            "is_heating": state.is_on,
        }

    def _state(self) -> FurnaceState:
        return decode_block(self.transport.read(self.config.block_index, 0, BLOCK_BYTES))

    def _command(self, bit: int) -> None:
        self._write(COMMANDS, bytes((bit,)))

    def _write(self, start: int, data: bytes) -> None:
        self.transport.write(self.config.block_index, start, data)
