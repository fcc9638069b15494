"""IKA RCT digital heating plate with magnetic stirrer.

Protocol: NAMUR, 9600 7E1, text lines CR LF; setters are silent, queries answer value and channel.
Quality: bronze, simulated instrument.
Safe state: heater off, motor off; on a lost link it goes on, its own watchdog is not armed.

Setters have no answer, so each is proved by reading the setpoint back before the start.

Source:
    IKA, operating instructions of Plate (RCT digital), table "NAMUR Commands".
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import msgspec

from drivers.base import (
    Accuracy,
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
from drivers.waiting import (
    WantedReading,
    await_reading,
    once_started,
    refuse_unless_near,
    watch_reading,
)
from labweb.domain.errors import PreconditionError, RejectedError

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
        wanted = WantedReading(temperature_c, tolerance_c, "°C", self.config.settle_s)
        started_s = self.now_s()
        with once_started(self._heater_off, self._heat, driver=self):
            limit_s, poll_s = self.config.heat_limit_s, self.config.poll_s
            await_reading(self, self.temperature_c, wanted, limit_s=limit_s, poll_s=poll_s)
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
        wanted = WantedReading(temperature_c, tolerance_c, "°C")
        with before_acting():
            refuse_unless_near(self.temperature_c(), wanted)
        self._start_heating(temperature_c)
        started_s = self.now_s()
        with once_started(self._heater_off, self._heat, lasted="held_s", driver=self):
            times = {"poll_s": self.config.poll_s, "grace_s": self.config.grace_s}
            watch_reading(self, self.temperature_c, wanted, duration_s=duration_s, **times)
            return self._heat_report(started_s)

    def _start_heating(self, temperature_c: float) -> None:
        self.refuse_if_stopped()
        self._refuse_above("temperature", temperature_c, self.config.max_temperature_c)
        self._set(TEMPERATURE, temperature_c)
        self._send("START_1")

    def _await_speed(self, speed_rpm: float) -> Report:
        """Return once the motor has the speed; running down is watched while stopped, too."""
        with once_started(lambda: self._send("STOP_4"), self._speed, driver=self):
            reading_rpm = await_reading(
                self,
                self.speed_rpm,
                WantedReading(speed_rpm, SPEED_TOLERANCE_RPM, "rpm"),
                limit_s=SPEED_LIMIT_S,
                poll_s=self.config.poll_s,
                is_stopping=speed_rpm == 0,
            )
        return Report(evidence={"speed_rpm": reading_rpm})

    def _speed(self) -> dict[str, float]:
        return {"speed_rpm": self.speed_rpm()}

    def _heater_off(self) -> None:
        self._send("STOP_1")

    def _heat(self) -> dict[str, float]:
        return {"temperature_c": self.temperature_c()}

    def _heat_report(self, started_s: float) -> Report:
        evidence = {
            "temperature_c": self.temperature_c(),
            "temperature_setpoint_c": self.temperature_setpoint_c(),
            "duration_s": round(self.now_s() - started_s, 3),
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
