"""IKA RCT digital heating plate with magnetic stirrer.

Protocol: NAMUR, 9600 7E1, text lines CR LF; setters are silent, queries answer value and channel.
Quality: bronze, simulated instrument.
Safe state: heater off, motor off; on a lost link it goes on, its own watchdog is not armed.

Setters have no answer, so each is proved by reading the setpoint back before the start.

Source:
    IKA, operating instructions of Plate (RCT digital), table "NAMUR Commands".
"""

from __future__ import annotations

import time
from typing import Annotated, ClassVar, Literal

import msgspec

from drivers.base import (
    Accuracy,
    DeviceStoppedError,
    Driver,
    Quantity,
    Range,
    Report,
    action,
    after_acting,
    before_acting,
    status,
)
from drivers.interfaces.heater_stirrer import HeaterStirrer
from drivers.processing._namur import END, decode_value, encode_line
from drivers.transports.base import ByteTransport
from labweb.domain.errors import (
    DeviceError,
    Effect,
    PreconditionError,
    RejectedError,
)

MODEL = "RCT digital"
TEMPERATURE, PLATE, SPEED = 1, 2, 4
"""Channels: 1 is the external reading and the temperature setpoint."""

ANSWER_S = 1.0
SPEED_LIMIT_S = 30.0
"""Longest time for the motor to reach a speed or to stand."""

SPEED_TOLERANCE_RPM = 20.0

Temperature = Annotated[float, Range(0.0, 310.0), Accuracy()]
Tolerance = Annotated[float, Range(0.1, 50.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One hotplate."""

    sensor: Literal["external", "plate"] = "external"
    """Thermometer that is controlled: the Pt1000 in the medium, or the plate's own."""

    max_temperature_c: Annotated[float, Range(0.0, 310.0)] = 310.0
    max_speed_rpm: Annotated[float, Range(0.0, 1500.0)] = 1500.0
    heat_limit_s: Annotated[float, Range(0.1, 14_000.0)] = 7200.0
    """Longest time to reach a temperature."""

    settle_s: Annotated[float, Range(0.0, 600.0)] = 2.0
    """How long the reading must stay within tolerance."""

    grace_s: Annotated[float, Range(0.0, 600.0)] = 10.0
    """How long a held temperature may leave its tolerance."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.5


class IkaRctDigital(Driver[ByteTransport, Config], HeaterStirrer):
    """One hotplate."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the name, and refuse another model."""
        answer = self._exchange("IN_NAME")
        name = answer.removesuffix(END).decode("ascii", errors="replace").strip()
        if name != MODEL:
            raise RejectedError(
                f"{self.transport.line} answers as {name!r}, expected {MODEL!r}",
                context={"model": name},
            )

    def halt(self) -> None:
        """Turn heater and motor off."""
        self._send("STOP_1")
        self._send("STOP_4")

    @status(every_s=1.0)
    def temperature_c(self) -> Annotated[float, Accuracy()]:
        """Tell the reading that is controlled: the medium's, unless set to the plate's."""
        return self._value("IN_PV", TEMPERATURE if self.config.sensor == "external" else PLATE)

    @status(every_s=1.0)
    def plate_temperature_c(self) -> float:
        """Tell the plate's reading."""
        return self._value("IN_PV", PLATE)

    @status(every_s=2.0)
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature."""
        return self._value("IN_SP", TEMPERATURE)

    @status(every_s=1.0)
    def speed_rpm(self) -> float:
        """Tell the motor's reading."""
        return self._value("IN_PV", SPEED)

    @status(every_s=2.0)
    def speed_setpoint_rpm(self) -> float:
        """Tell the wanted speed."""
        return self._value("IN_SP", SPEED)

    @action(timeout_s=14_400.0, recovery="R1", hazards=("heat",))
    def heat_to(self, temperature_c: Temperature, tolerance_c: Tolerance) -> Report:
        """Heat, and return once the reading has stayed within tolerance.

        Raises:
            DeviceError: Not reached in time, or stopped: the heater is off again, and
                `context["temperature_c"]` says how far it came (PARTIAL).

        Effect:
            The heater stays on with this setpoint.
        """
        self._start_heating(temperature_c)
        with after_acting():
            started_s = time.monotonic()
            try:
                self._await_temperature(temperature_c, tolerance_c)
            except DeviceError as error:
                self._heater_off(error)
                raise
            return self._heat_report(started_s)

    @action(timeout_s=10.0, recovery="R1")
    def stop_heating(self) -> Report:
        """Turn the heater off; what is hot cools by itself.

        Effect:
            The heater is off.
        """
        self._send("STOP_1")
        with after_acting():
            return Report(evidence={"temperature_c": self.temperature_c()})

    @action(timeout_s=60.0, recovery="R1", hazards=("moving_parts",))
    def stir(self, speed_rpm: Annotated[float, Range(0.0, 1500.0)]) -> Report:
        """Stir, and return once the speed is reached.

        Raises:
            DeviceError: Not reached in time, or stopped: the motor is off again (PARTIAL).

        Effect:
            The motor stays on with this setpoint.
        """
        self.refuse_if_stopped()
        self._refuse_above("speed", speed_rpm, self.config.max_speed_rpm)
        self._set(SPEED, speed_rpm)
        self._send("START_4")
        with after_acting():
            return self._await_speed(speed_rpm)

    @action(timeout_s=60.0, recovery="R1")
    def stop_stirring(self) -> Report:
        """Turn the motor off, and return once it stands.

        Effect:
            The motor is off.
        """
        self._send("STOP_4")
        with after_acting():
            return self._await_speed(0.0)

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
            PreconditionError: The reading is not within tolerance at the start (NONE).
            DeviceError: It left the tolerance for longer than the grace time, or stopped: the
                heater is off, and `context["held_s"]` says after how long (PARTIAL).

        Effect:
            The heater stays on with this setpoint.
        """
        self.refuse_if_stopped()
        with before_acting():
            reading_c = self.temperature_c()
        if abs(reading_c - temperature_c) > tolerance_c:
            raise PreconditionError(
                f"reading is {reading_c:g} °C, not within {tolerance_c:g} K of "
                f"{temperature_c:g} °C: heat first",
                code="device.not_at_temperature",
                context={"temperature_c": reading_c},
            )
        self._start_heating(temperature_c)
        with after_acting():
            started_s = time.monotonic()
            try:
                self._watch(started_s + duration_s, temperature_c, tolerance_c)
            except DeviceError as error:
                error.context["held_s"] = round(time.monotonic() - started_s, 3)
                self._heater_off(error)
                raise
            return self._heat_report(started_s)

    def _start_heating(self, temperature_c: float) -> None:
        self.refuse_if_stopped()
        self._refuse_above("temperature", temperature_c, self.config.max_temperature_c)
        self._set(TEMPERATURE, temperature_c)
        self._send("START_1")

    def _await_temperature(self, temperature_c: float, tolerance_c: float) -> None:
        deadline_s = time.monotonic() + self.config.heat_limit_s
        within_since_s: float | None = None
        while True:
            self.pause(self.config.poll_s)
            reading_c = self.temperature_c()
            now_s = time.monotonic()
            if abs(reading_c - temperature_c) > tolerance_c:
                within_since_s = None
            elif within_since_s is None:
                within_since_s = now_s
            if within_since_s is not None and now_s - within_since_s >= self.config.settle_s:
                return
            if now_s > deadline_s:
                raise DeviceError(
                    f"{temperature_c:g} °C not reached in {self.config.heat_limit_s:g} s",
                    code="device.not_reached",
                )

    def _watch(self, end_s: float, temperature_c: float, tolerance_c: float) -> None:
        last_good_s = time.monotonic()
        while (left_s := end_s - time.monotonic()) > 0:
            self.pause(min(left_s, self.config.poll_s))
            reading_c = self.temperature_c()
            if abs(reading_c - temperature_c) <= tolerance_c:
                last_good_s = time.monotonic()
            elif time.monotonic() - last_good_s > self.config.grace_s:
                raise DeviceError(
                    f"reading left {temperature_c:g} ± {tolerance_c:g} °C: {reading_c:g} °C",
                    code="device.not_held",
                )
        self.pause(0)

    def _await_speed(self, speed_rpm: float) -> Report:
        deadline_s = time.monotonic() + SPEED_LIMIT_S
        try:
            while abs((reading_rpm := self.speed_rpm()) - speed_rpm) > SPEED_TOLERANCE_RPM:
                if time.monotonic() > deadline_s:
                    raise DeviceError(
                        f"motor runs at {reading_rpm:g} rpm, asked for {speed_rpm:g} rpm",
                        code="device.not_reached",
                        context={"speed_rpm": reading_rpm},
                    )
                self._wait_for_motor(speed_rpm)
            if speed_rpm > 0:
                self.pause(0)
        except DeviceError as error:
            self._send("STOP_4")
            if error.code in {"device.not_reached", DeviceStoppedError.default_code}:
                error.context["speed_rpm"] = self.speed_rpm()
                error.effect = Effect.PARTIAL
            raise
        return Report(evidence={"speed_rpm": reading_rpm})

    def _wait_for_motor(self, speed_rpm: float) -> None:
        """Wait between two readings; running down may be watched while stopped."""
        if speed_rpm > 0:
            self.pause(self.config.poll_s)
        else:
            self.rest(self.config.poll_s)

    def _heater_off(self, error: DeviceError) -> None:
        """Leave a failed heating cold, and say how warm it got."""
        self._send("STOP_1")
        if error.code in {
            "device.not_reached",
            "device.not_held",
            DeviceStoppedError.default_code,
        }:
            error.context["temperature_c"] = self.temperature_c()
            error.effect = Effect.PARTIAL

    def _heat_report(self, started_s: float) -> Report:
        evidence = {
            "temperature_c": self.temperature_c(),
            "temperature_setpoint_c": self.temperature_setpoint_c(),
            "duration_s": round(time.monotonic() - started_s, 3),
        }
        return Report(evidence=evidence)

    def _set(self, channel: int, value: float) -> None:
        """Write a setpoint and read it back, which moves nothing before a start."""
        written = round(value, 1) if channel == TEMPERATURE else round(value)
        with before_acting():
            self._send(f"OUT_SP_{channel} {written:g}")
            accepted = self._value("IN_SP", channel)
            if abs(accepted - written) > 0.6:  # devices may round to whole units
                raise RejectedError(
                    f"setpoint {channel} is {accepted:g} after writing {written:g}",
                    context={"setpoint": accepted},
                )

    def _refuse_above(self, name: str, value: float, limit: float) -> None:
        if value > limit:
            raise PreconditionError(
                f"{name} {value:g} was asked for; this device is limited to {limit:g}",
                code="device.limit",
            )

    def _value(self, command: str, channel: int) -> float:
        return decode_value(self._exchange(f"{command}_{channel}"), channel)

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)

    def _send(self, command: str) -> None:
        self.transport.send(encode_line(command))
