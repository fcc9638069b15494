"""IKA RET control-visc heating plate with magnetic stirrer.

Protocol: NAMUR, 9600 7E1, text lines CR LF; setters are silent, queries answer value and channel.
Quality: bronze, simulated instrument.
Safe state: heater off, motor off; on a lost link it goes on, its own watchdog is not armed.

Medium and plate have a setpoint each, on the channel of their thermometer. Setters have no
answer, so each is proved by reading the setpoint back before the start.

Source:
    IKA, operating instructions of RET control-visc, table "NAMUR Commands".
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import msgspec

from drivers.base import Accuracy, Driver, Quantity, Range, Report, action, before_acting, status
from drivers.interfaces.heater_stirrer import HeaterStirrer
from drivers.processing._namur import (
    END,
    ROUNDING,
    decode_text,
    decode_value,
    encode_line,
    refuse_other,
)
from drivers.transports.base import ByteTransport
from drivers.waiting import (
    WantedReading,
    await_reading,
    once_started,
    refuse_beyond,
    refuse_unless_near,
    refuse_untaken,
    watch_reading,
)

MEDIUM, PLATE, SPEED = 1, 2, 4
"""Channels: readings and setpoints have the same number."""

HEATER, MOTOR = 1, 4
"""Numbers of START and STOP."""

ANSWER_S = 1.0
SPEED_TOLERANCE_RPM = 20.0

Temperature = Annotated[float, Range(0.0, 340.0), Accuracy()]
Tolerance = Annotated[float, Range(0.1, 50.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One hotplate."""

    name: str = "IKARET"
    """What it answers to IN_NAME; a person may have named it otherwise."""

    sensor: Literal["external", "plate"] = "external"
    """Thermometer that is controlled: the Pt1000 in the medium, or the plate's own."""

    max_temperature_c: Temperature = 340.0
    max_speed_rpm: Annotated[float, Range(50.0, 1700.0)] = 1700.0
    heat_limit_s: Annotated[float, Range(0.1, 14_000.0)] = 7200.0
    """Longest time to reach a temperature."""

    speed_limit_s: Annotated[float, Range(0.1, 50.0)] = 30.0
    """Longest time to reach a speed, or to stand."""

    settle_s: Annotated[float, Range(0.0, 600.0)] = 2.0
    """How long the reading must stay within tolerance."""

    grace_s: Annotated[float, Range(0.0, 600.0)] = 10.0
    """How long a held temperature may leave its tolerance."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.5


class IkaRetControlVisc(Driver[ByteTransport, Config], HeaterStirrer):
    """One hotplate."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the name, and refuse another one than was set."""
        name = decode_text(self._exchange("IN_NAME"))
        refuse_other(self.transport, name, self.config.name)

    def halt(self) -> None:
        """Turn heater and motor off."""
        self._send(f"STOP_{HEATER}")
        self._send(f"STOP_{MOTOR}")

    @status(every_s=1.0)
    def temperature_c(self) -> Annotated[float, Accuracy()]:
        """Tell the reading that is controlled: the medium's, unless set to the plate's."""
        return self._value("IN_PV", self._controlled)

    @status(every_s=1.0)
    def plate_temperature_c(self) -> float:
        """Tell the plate's reading."""
        return self._value("IN_PV", PLATE)

    @status(every_s=2.0)
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature of the medium, or of the plate if that is controlled."""
        return self._value("IN_SP", self._controlled)

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
        self._check_heating(temperature_c)
        with once_started(self._heater_off, self._temperatures, driver=self):
            self._start_heating(temperature_c)
            await_reading(
                self,
                self.temperature_c,
                WantedReading(temperature_c, tolerance_c, "°C", self.config.settle_s),
                limit_s=self.config.heat_limit_s,
                poll_s=self.config.poll_s,
            )
            return Report(evidence=self._temperatures())

    @action(timeout_s=10.0, recovery="R1")
    def stop_heating(self) -> Report:
        """Turn the heater off; what is hot cools by itself.

        Effect:
            The heater is off.
        """
        self._heater_off()
        with once_started(self._heater_off, dict, driver=self):
            return Report(evidence=self._temperatures())

    @action(timeout_s=60.0, recovery="R1", hazards=("moving_parts",))
    def stir(self, speed_rpm: Annotated[float, Range(50.0, 1700.0)]) -> Report:
        """Stir, and return once the speed is reached.

        Raises:
            DeviceError: Not reached in time, or stopped: the motor is off again (PARTIAL).

        Effect:
            The motor stays on with this setpoint.
        """
        self.refuse_if_stopped()
        refuse_beyond("speed", speed_rpm, 0.0, self.config.max_speed_rpm)
        with before_acting():
            self.speed_rpm()
        with once_started(self._motor_off, self._speeds, driver=self):
            self._set(SPEED, round(speed_rpm))
            self._send(f"START_{MOTOR}")
            await_reading(
                self,
                self.speed_rpm,
                WantedReading(speed_rpm, SPEED_TOLERANCE_RPM, "rpm"),
                limit_s=self.config.speed_limit_s,
                poll_s=self.config.poll_s,
            )
            return Report(evidence=self._speeds())

    @action(timeout_s=60.0, recovery="R1")
    def stop_stirring(self) -> Report:
        """Turn the motor off, and return once it stands.

        Effect:
            The motor is off.
        """
        self._motor_off()
        with once_started(self._motor_off, self._speeds, driver=self):
            await_reading(
                self,
                self.speed_rpm,
                WantedReading(0.0, SPEED_TOLERANCE_RPM, "rpm"),
                limit_s=self.config.speed_limit_s,
                poll_s=self.config.poll_s,
                is_stopping=True,
            )
            return Report(evidence=self._speeds())

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
        wanted = WantedReading(temperature_c, tolerance_c, "°C")
        refuse_unless_near(self._check_heating(temperature_c), wanted)
        with once_started(self._heater_off, self._temperatures, lasted="held_s", driver=self):
            self._start_heating(temperature_c)
            started_s = self.now_s()
            watch_reading(
                self,
                self.temperature_c,
                wanted,
                duration_s=duration_s,
                poll_s=self.config.poll_s,
                grace_s=self.config.grace_s,
            )
            held_s = round(self.now_s() - started_s, 3)
            return Report(evidence={**self._temperatures(), "held_s": held_s})

    def _check_heating(self, temperature_c: float) -> float:
        """Return the reading before anything is sent that acts."""
        self.refuse_if_stopped()
        refuse_beyond("temperature", temperature_c, 0.0, self.config.max_temperature_c)
        with before_acting():
            return self.temperature_c()

    def _start_heating(self, temperature_c: float) -> None:
        self._set(self._controlled, round(temperature_c, 1))
        self._send(f"START_{HEATER}")

    def _temperatures(self) -> dict[str, Any]:
        return {
            "temperature_c": self.temperature_c(),
            "temperature_setpoint_c": self.temperature_setpoint_c(),
        }

    def _speeds(self) -> dict[str, Any]:
        return {"speed_rpm": self.speed_rpm(), "speed_setpoint_rpm": self.speed_setpoint_rpm()}

    def _heater_off(self) -> None:
        self._send(f"STOP_{HEATER}")

    def _motor_off(self) -> None:
        self._send(f"STOP_{MOTOR}")

    def _set(self, channel: int, value: float) -> None:
        """Write a setpoint and read it back; what already runs follows it at once."""
        self._send(f"OUT_SP_{channel} {value:g}")
        taken = self._value("IN_SP", channel)
        refuse_untaken(f"setpoint {channel}", taken, value, resolution=ROUNDING)

    @property
    def _controlled(self) -> int:
        return MEDIUM if self.config.sensor == "external" else PLATE

    def _value(self, command: str, channel: int) -> float:
        return decode_value(self._exchange(f"{command}_{channel}"), channel)

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)

    def _send(self, command: str) -> None:
        self.transport.send(encode_line(command))
