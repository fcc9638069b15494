"""QInstruments BioShake orbital shaker with heating and plate clamps.

Protocol: QInstruments text lines, 9600 8N1, CR in and CR LF out; answers are a value, ok, e or u.
Quality: bronze, simulated instrument.
Safe state: shaker at home, heater off, plate locked; on a lost link it goes on.

Source:
    QInstruments, BioShake integration manual, table of remote control commands.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Accuracy, Driver, Quantity, Range, Report, action, before_acting, status
from drivers.interfaces.shaker import Shaker
from drivers.interfaces.temperature_controller import TemperatureController
from drivers.transports.base import ByteTransport
from drivers.waiting import (
    TemperatureControl,
    WantedReading,
    await_reading,
    once_started,
    refuse_beyond,
)
from labweb.domain.errors import FrameError, RejectedError

END = b"\r\n"
TENTHS = 10
SPEED_TOLERANCE_RPM = 25.0
STAND_S = 3.0
"""Time to stand still, by the manual; clamps do not move before."""

ANSWER_S = 2.0

Temperature = Annotated[float, Range(0.0, 99.0), Accuracy()]
Tolerance = Annotated[float, Range(0.1, 50.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One shaker."""

    max_speed_rpm: Annotated[float, Range(200.0, 3000.0)] = 3000.0
    max_temperature_c: Temperature = 99.0
    stand_s: Annotated[float, Range(0.0, 30.0)] = STAND_S
    """Time to wait after it was stopped."""

    speed_limit_s: Annotated[float, Range(0.1, 100.0)] = 60.0
    """Longest time to reach a speed, or to stand."""

    reach_limit_s: Annotated[float, Range(0.1, 14_000.0)] = 7200.0
    """Longest time to reach a temperature."""

    settle_s: Annotated[float, Range(0.0, 600.0)] = 5.0
    """How long the temperature must stay within tolerance."""

    grace_s: Annotated[float, Range(0.0, 600.0)] = 30.0
    """How long a held temperature may leave its tolerance."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.5


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("setShakeTargetSpeed500")
        b'setShakeTargetSpeed500\r'
    """
    return f"{command}\r".encode("ascii")


def decode_line(frame: bytes, command: str) -> str:
    r"""Read an answer.

    Raises:
        RejectedError: The shaker refused, by its manual without moving.
        FrameError: Not text.

    Example:
        >>> decode_line(b"ok\r\n", "shakeOn")
        'ok'
    """
    if not re.fullmatch(rb"[\x20-\x7e]+\r\n", frame):
        raise FrameError(f"no answer to {command}", context={"frame": frame.hex()})
    text = frame.decode("ascii").strip()
    if text == "e" or text.startswith("u ->"):
        reason = "cannot do that now" if text == "e" else "does not know the command"
        raise RejectedError(f"{command}: the shaker {reason}", context={"answer": text})
    return text


class Bioshake(Driver[ByteTransport, Config], Shaker, TemperatureController):
    """One shaker."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the limits of the speed, and refuse a device that has none."""
        low_rpm, high_rpm = self._number("getShakeMinRpm"), self._number("getShakeMaxRpm")
        if not 0 < low_rpm < high_rpm:
            raise RejectedError(f"speeds from {low_rpm:g} to {high_rpm:g} rpm are no shaker's")

    def halt(self) -> None:
        """Stop shaking and heating; the plate stays locked."""
        self._tell("shakeOff")
        self._tell("tempOff")

    @status(every_s=2.0)
    def speed_rpm(self) -> float:
        """Tell the speed of the table."""
        return self._number("getShakeActualSpeed")

    @status(every_s=2.0)
    def temperature_c(self) -> Annotated[float, Accuracy()]:
        """Tell the temperature of the table."""
        return self._number("getTempActual")

    @status(every_s=4.0)
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature."""
        return self._number("getTempTarget")

    @status(every_s=4.0)
    def is_heating(self) -> bool:
        """Tell whether the temperature control is on."""
        return self._number("getTempState") == 1

    @action(timeout_s=120.0, recovery="R1", hazards=("moving_parts",))
    def shake(
        self,
        speed_rpm: Annotated[float, Range(200.0, 3000.0)],
        ramp_s: Annotated[float, Range(1.0, 30.0)],
    ) -> Report:
        """Lock the plate and shake it, and return once the speed is reached.

        Raises:
            DeviceError: Not reached in time, or stopped: the shaker is off again (PARTIAL).

        Effect:
            The shaker stays on with this setpoint.
        """
        self.refuse_if_stopped()
        refuse_beyond("speed", speed_rpm, 0.0, self.config.max_speed_rpm)
        with before_acting():
            low_rpm, high_rpm = self._number("getShakeMinRpm"), self._number("getShakeMaxRpm")
            refuse_beyond("speed", speed_rpm, low_rpm, high_rpm)
        with once_started(self._shake_off, self._speeds, driver=self):
            self._tell("setElmLockPos")
            self._tell(f"setShakeAcceleration{round(ramp_s)}")
            self._tell(f"setShakeTargetSpeed{round(speed_rpm)}")
            self._tell("shakeOn")
            self._await_speed(speed_rpm)
            return Report(evidence=self._speeds())

    @action(timeout_s=120.0, recovery="R1")
    def stop_shaking(self) -> Report:
        """Stop, and return once the table stands.

        Effect:
            The shaker is off; the plate stays locked.
        """
        with once_started(self._shake_off, self._speeds, driver=self):
            self._shake_off()
            self._await_speed(0.0)
            self.rest(self.config.stand_s)
            return Report(evidence=self._speeds())

    @action(timeout_s=15.0, recovery="R1", hazards=("moving_parts",))
    def lock_plate(self) -> Report:
        """Close the clamps.

        Effect:
            The plate cannot be taken.
        """
        self.refuse_if_stopped()
        self._tell("setElmLockPos")
        return Report()

    @action(timeout_s=15.0, recovery="R1", hazards=("moving_parts",))
    def unlock_plate(self) -> Report:
        """Open the clamps; the shaker refuses unless it stands.

        Effect:
            The plate can be taken.
        """
        self.refuse_if_stopped()
        self._tell("setElmUnlockPos")
        return Report()

    @action(timeout_s=14_400.0, recovery="R1", hazards=("heat",))
    def reach_temperature(self, temperature_c: Temperature, tolerance_c: Tolerance) -> Report:
        """Return once the reading has stayed within tolerance.

        Raises:
            DeviceError: Not reached in time, or stopped: the heater is off again, and
                `context["temperature_c"]` says how far it came (PARTIAL).

        Effect:
            The heater stays on with this setpoint.
        """
        self._check_heating(temperature_c)
        return self._control.reach(temperature_c, tolerance_c)

    @action(timeout_s=604_800.0, recovery="R3", hazards=("heat",))
    def hold(
        self,
        duration_s: Annotated[float, Range(0.0, 600_000.0)],
        temperature_c: Temperature,
        tolerance_c: Tolerance,
    ) -> Report:
        """Keep a temperature that is already reached for a while, and watch it.

        Raises:
            PreconditionError: The reading is not within tolerance at the start (NONE).
            DeviceError: It left the tolerance for longer than the grace time, or stopped: the
                heater is off, and `context["held_s"]` says after how long (PARTIAL).

        Effect:
            The heater stays on with this setpoint.
        """
        reading_c = self._check_heating(temperature_c)
        return self._control.hold(reading_c, duration_s, temperature_c, tolerance_c)

    @action(timeout_s=30.0, recovery="R1")
    def stop_control(self) -> Report:
        """Turn the heater off; what is hot cools by itself.

        Effect:
            The heater is off.
        """
        with once_started(self._heater_off, self._temperatures, driver=self):
            self._heater_off()
            return Report(evidence=self._temperatures())

    @property
    def _control(self) -> TemperatureControl:
        return TemperatureControl(
            driver=self,
            read=self.temperature_c,
            begin=self._start_heating,
            end=self._heater_off,
            describe=self._temperatures,
        )

    def _check_heating(self, temperature_c: float) -> float:
        """Return the reading before anything is sent that acts."""
        self.refuse_if_stopped()
        refuse_beyond("temperature", temperature_c, 0.0, self.config.max_temperature_c)
        with before_acting():
            low_c, high_c = self._number("getTempMin"), self._number("getTempMax")
            refuse_beyond("temperature", temperature_c, low_c, high_c)
            return self.temperature_c()

    def _start_heating(self, temperature_c: float) -> None:
        self._tell(f"setTempTarget{round(temperature_c * TENTHS)}")
        self._tell("tempOn")

    def _await_speed(self, speed_rpm: float) -> None:
        await_reading(
            self,
            self.speed_rpm,
            WantedReading(speed_rpm, SPEED_TOLERANCE_RPM, "rpm"),
            limit_s=self.config.speed_limit_s,
            poll_s=self.config.poll_s,
            is_stopping=speed_rpm == 0,
        )

    def _shake_off(self) -> None:
        self._tell("shakeOff")

    def _heater_off(self) -> None:
        self._tell("tempOff")

    def _speeds(self) -> dict[str, Any]:
        return {"speed_rpm": self.speed_rpm()}

    def _temperatures(self) -> dict[str, Any]:
        return {"temperature_c": self.temperature_c()}

    def _tell(self, command: str) -> None:
        if (answer := self._ask(command)) != "ok":
            raise FrameError(f"{command} was answered with {answer!r}")

    def _number(self, command: str) -> float:
        answer = self._ask(command)
        if not re.fullmatch(r"-?[0-9]{1,5}(\.[0-9]{1,3})?", answer):
            raise FrameError(f"{command} was answered with {answer!r}, not with a number")
        return float(answer)

    def _ask(self, command: str) -> str:
        frame = self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)
        return decode_line(frame, command)
