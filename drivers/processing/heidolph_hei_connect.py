"""Heidolph MR Hei-Connect heating plate with magnetic stirrer.

Protocol: Heidolph text lines, 9600 7E1, CR LF, 0.1 s apart; each answer repeats its command.
Quality: bronze, simulated instrument.
Safe state: heater off, motor off; on a lost link it goes on, its connection check is not armed.

The plate itself chooses its thermometer: with a sensor plugged in it controls the medium.
The driver refuses to heat when that is not the one that was set.

Source:
    Heidolph, instruction manual of MR Hei-Connect, section "Interface", command table.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from drivers.base import Accuracy, Driver, Quantity, Range, Report, action, before_acting, status
from drivers.interfaces.heater_stirrer import HeaterStirrer
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
from labweb.domain.errors import FrameError, RejectedError

END = b"\r\n"
HEATER, MOTOR = 1, 2
"""Numbers of START and STOP."""

MEDIUM, PLATE, SPEED = 1, 3, 5
"""Channels of readings."""

TEMPERATURE_SETPOINT, SPEED_SETPOINT = 1, 3
"""Channels of setpoints."""

SENSOR_OF_MODE = {0: "plate", 1: "external"}
BLOCKED = -1
ANSWER_S = 1.0
SPEED_TOLERANCE_RPM = 20.0

Temperature = Annotated[float, Range(0.0, 300.0), Accuracy()]
Tolerance = Annotated[float, Range(0.1, 50.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One hotplate."""

    sensor: Literal["external", "plate"] = "external"
    """Thermometer that is controlled: the one in the medium, or the plate's own."""

    max_temperature_c: Temperature = 300.0
    max_speed_rpm: Annotated[float, Range(30.0, 1400.0)] = 1400.0
    heat_limit_s: Annotated[float, Range(0.1, 14_000.0)] = 7200.0
    """Longest time to reach a temperature."""

    speed_limit_s: Annotated[float, Range(0.1, 50.0)] = 30.0
    """Longest time to reach a speed, or to stand."""

    settle_s: Annotated[float, Range(0.0, 600.0)] = 2.0
    """How long the reading must stay within tolerance."""

    grace_s: Annotated[float, Range(0.0, 600.0)] = 10.0
    """How long a held temperature may leave its tolerance."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.5
    gap_s: Annotated[float, Range(0.0, 5.0)] = 0.1
    """Least time between two commands."""


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("START_1")
        b'START_1\r\n'
    """
    return f"{command}\r\n".encode("ascii")


def decode_echo(frame: bytes, name: str) -> float | None:
    r"""Read what follows the command's name in its answer; None when nothing does.

    Raises:
        FrameError: Not an answer to this command.

    Example:
        >>> decode_echo(b"IN_PV_1 25.3\r\n", "IN_PV_1")
        25.3
    """
    match = re.fullmatch(rb"([A-Z0-9_]+)(?: +(-?[0-9]{1,6}(?:\.[0-9]{1,4})?))? *\r\n", frame)
    if match is None or match[1].decode("ascii") != name:
        raise FrameError(f"no answer to {name}", context={"frame": frame.hex()})
    return None if match[2] is None else float(match[2])


class HeidolphHeiConnect(Driver[ByteTransport, Config], HeaterStirrer):
    """One hotplate."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Choose the current command set, which no other plate of the maker knows."""
        self._tell("PA_NEW")

    def halt(self) -> None:
        """Turn heater and motor off."""
        self._heater_off()
        self._motor_off()

    @status(every_s=1.0)
    def temperature_c(self) -> Annotated[float, Accuracy()]:
        """Tell the reading that is controlled: the medium's, unless set to the plate's."""
        return self._value(f"IN_PV_{MEDIUM if self.config.sensor == 'external' else PLATE}")

    @status(every_s=1.0)
    def plate_temperature_c(self) -> float:
        """Tell the plate's reading."""
        return self._value(f"IN_PV_{PLATE}")

    @status(every_s=2.0)
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature."""
        return self._value(f"IN_SP_{TEMPERATURE_SETPOINT}")

    @status(every_s=1.0)
    def speed_rpm(self) -> float:
        """Tell the motor's reading."""
        return self._value(f"IN_PV_{SPEED}")

    @status(every_s=2.0)
    def speed_setpoint_rpm(self) -> float:
        """Tell the wanted speed."""
        return self._value(f"IN_SP_{SPEED_SETPOINT}")

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
    def stir(self, speed_rpm: Annotated[float, Range(30.0, 1400.0)]) -> Report:
        """Stir, and return once the speed is reached.

        Raises:
            DeviceError: Not reached in time, or stopped: the motor is off again (PARTIAL).

        Effect:
            The motor stays on with this setpoint.
        """
        self.refuse_if_stopped()
        refuse_beyond("speed", speed_rpm, 0.0, self.config.max_speed_rpm)
        with before_acting():
            self._refuse_blocked()
        with once_started(self._motor_off, self._speeds, driver=self):
            self._set(SPEED_SETPOINT, round(speed_rpm))
            self._tell(f"START_{MOTOR}")
            return self._await_speed(speed_rpm)

    @action(timeout_s=60.0, recovery="R1")
    def stop_stirring(self) -> Report:
        """Turn the motor off, and return once it stands.

        Effect:
            The motor is off.
        """
        self._motor_off()
        with once_started(self._motor_off, self._speeds, driver=self):
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
            self._refuse_blocked()
            mode = self._value("IN_MODE_1")
            if SENSOR_OF_MODE.get(int(mode)) != self.config.sensor:
                raise RejectedError(
                    f"the plate controls by its {SENSOR_OF_MODE.get(int(mode), mode)} sensor, "
                    f"the {self.config.sensor} one is set: plug it in, or out",
                    context={"mode": mode},
                )
            return self.temperature_c()

    def _start_heating(self, temperature_c: float) -> None:
        self._set(TEMPERATURE_SETPOINT, round(temperature_c))
        self._tell(f"START_{HEATER}")

    def _refuse_blocked(self) -> None:
        if self._value("STATUS") == BLOCKED:
            raise RejectedError(
                "the plate reports that it is blocked: look at it, and at its display"
            )

    def _await_speed(self, speed_rpm: float) -> Report:
        await_reading(
            self,
            self.speed_rpm,
            WantedReading(speed_rpm, SPEED_TOLERANCE_RPM, "rpm"),
            limit_s=self.config.speed_limit_s,
            poll_s=self.config.poll_s,
            is_stopping=speed_rpm == 0,
        )
        return Report(evidence=self._speeds())

    def _temperatures(self) -> dict[str, Any]:
        return {
            "temperature_c": self.temperature_c(),
            "temperature_setpoint_c": self.temperature_setpoint_c(),
        }

    def _speeds(self) -> dict[str, Any]:
        return {"speed_rpm": self.speed_rpm(), "speed_setpoint_rpm": self.speed_setpoint_rpm()}

    def _heater_off(self) -> None:
        self._tell(f"STOP_{HEATER}")

    def _motor_off(self) -> None:
        self._tell(f"STOP_{MOTOR}")

    def _set(self, channel: int, value: float) -> None:
        """Write a setpoint and read it back; what already runs follows it at once."""
        self._ask(f"OUT_SP_{channel}", f" {value:g}")
        taken = self._value(f"IN_SP_{channel}")
        refuse_untaken(f"setpoint {channel}", taken, value, resolution=0.0)

    def _tell(self, command: str) -> None:
        self._ask(command)

    def _value(self, name: str) -> float:
        value = self._ask(name)
        if value is None:
            raise FrameError(f"answer to {name} has no value")
        return value

    def _ask(self, name: str, argument: str = "") -> float | None:
        frame = self.transport.exchange(
            encode_line(name + argument), until=END, timeout_s=ANSWER_S, gap_s=self.config.gap_s
        )
        return decode_echo(frame, name)
