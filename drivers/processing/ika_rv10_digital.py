"""IKA RV10 digital rotary evaporator with its heating bath.

Protocol: NAMUR, 9600 7E1, text lines CR LF; setters are silent, queries answer value and channel.
Quality: bronze, simulated instrument.
Safe state: bath off, drive off, lift where it is; on a lost link bath and drive go on.

The lift tells neither where it is nor that it has arrived: its actions wait for the time of
a whole stroke, and a lift in doubt is looked at by a person.

Source:
    IKA, operating instructions of RV 10 digital, NAMUR commands; 62 is up and 63 is down, as
    the maker corrected them.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Quantity, Range, Report, action, before_acting, status
from drivers.interfaces.rotary_evaporator import RotaryEvaporator
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
    refuse_untaken,
)
from labweb.domain.errors import DeviceError, FrameError

MODEL = "RV10Digital"
BATH, SPEED = 2, 4
"""Channels, and numbers of START and STOP."""

LIFT_UP, LIFT_DOWN = 62, 63
STATES = {"0", "1"}
"""Driven by hand, driven from afar; all else is a fault."""

FAULTS = {"E01": "no rotation", "E02": "no connection to the heating bath"}

ANSWER_S = 1.0
SPEED_TOLERANCE_RPM = 5.0

Temperature = Annotated[float, Range(0.0, 180.0)]
Tolerance = Annotated[float, Range(0.1, 50.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One evaporator."""

    max_temperature_c: Temperature = 180.0
    max_speed_rpm: Annotated[float, Range(1.0, 280.0)] = 280.0
    heat_limit_s: Annotated[float, Range(0.1, 14_000.0)] = 7200.0
    """Longest time to reach a temperature."""

    speed_limit_s: Annotated[float, Range(0.1, 50.0)] = 30.0
    """Longest time to reach a speed, or to stand."""

    lift_s: Annotated[float, Range(0.0, 50.0)] = 10.0
    """Time of a whole stroke of the lift."""

    settle_s: Annotated[float, Range(0.0, 600.0)] = 2.0
    """How long the bath must stay within tolerance."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.5


class IkaRv10Digital(Driver[ByteTransport, Config], RotaryEvaporator):
    """One rotary evaporator."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the name, and refuse another model; what follows the name is its version."""
        name = decode_text(self._exchange("IN_NAME"))
        refuse_other(self.transport, name[: len(MODEL)], MODEL)

    def halt(self) -> None:
        """Turn bath and drive off."""
        self._bath_off()
        self._drive_off()

    @status(every_s=1.0)
    def bath_temperature_c(self) -> float:
        """Tell the bath's reading."""
        return self._value("IN_PV", BATH)

    @status(every_s=2.0)
    def bath_setpoint_c(self) -> float:
        """Tell the wanted temperature of the bath."""
        return self._value("IN_SP", BATH)

    @status(every_s=1.0)
    def speed_rpm(self) -> float:
        """Tell the drive's reading."""
        return self._value("IN_PV", SPEED)

    @status(every_s=2.0)
    def speed_setpoint_rpm(self) -> float:
        """Tell the wanted speed."""
        return self._value("IN_SP", SPEED)

    @action(timeout_s=14_400.0, recovery="R1", hazards=("heat",))
    def heat_bath_to(self, temperature_c: Temperature, tolerance_c: Tolerance) -> Report:
        """Heat the bath, and return once its reading has stayed within tolerance.

        Raises:
            DeviceError: Not reached in time, or stopped: the bath is off again, and
                `context["bath_temperature_c"]` says how far it came (PARTIAL).

        Effect:
            The bath stays on with this setpoint.
        """
        self.refuse_if_stopped()
        refuse_beyond("temperature", temperature_c, 0.0, self.config.max_temperature_c)
        with before_acting():
            self._refuse_fault()
        with once_started(self._bath_off, self._temperatures, driver=self):
            self._set(BATH, round(temperature_c, 1))
            self._send(f"START_{BATH}")
            await_reading(
                self,
                self._bath_without_fault,
                WantedReading(temperature_c, tolerance_c, "°C", self.config.settle_s),
                limit_s=self.config.heat_limit_s,
                poll_s=self.config.poll_s,
            )
            return Report(evidence=self._temperatures())

    @action(timeout_s=10.0, recovery="R1")
    def stop_heating(self) -> Report:
        """Turn the bath off; what is hot cools by itself.

        Effect:
            The bath is off.
        """
        self._bath_off()
        with once_started(self._bath_off, dict, driver=self):
            return Report(evidence=self._temperatures())

    @action(timeout_s=60.0, recovery="R1", hazards=("moving_parts",))
    def rotate(self, speed_rpm: Annotated[float, Range(1.0, 280.0)]) -> Report:
        """Turn the flask, and return once the speed is reached.

        Raises:
            DeviceError: Not reached in time, or stopped: the drive is off again (PARTIAL).

        Effect:
            The drive stays on with this setpoint.
        """
        self.refuse_if_stopped()
        refuse_beyond("speed", speed_rpm, 0.0, self.config.max_speed_rpm)
        with before_acting():
            self._refuse_fault()
        with once_started(self._drive_off, self._speeds, driver=self):
            self._set(SPEED, round(speed_rpm))
            self._send(f"START_{SPEED}")
            return self._await_speed(speed_rpm)

    @action(timeout_s=60.0, recovery="R1")
    def stop_rotating(self) -> Report:
        """Turn the drive off, and return once the flask stands.

        Effect:
            The drive is off.
        """
        self._drive_off()
        with once_started(self._drive_off, self._speeds, driver=self):
            return self._await_speed(0.0)

    @action(timeout_s=60.0, recovery="R3", hazards=("moving_parts",))
    def raise_flask(self) -> Report:
        """Lift the flask out of the bath, and return after the time of a whole stroke.

        Effect:
            The lift is up; the instrument has no way to say so.
        """
        return self._lift(LIFT_UP)

    @action(timeout_s=60.0, recovery="R3", hazards=("moving_parts",))
    def lower_flask(self) -> Report:
        """Lower the flask into the bath, and return after the time of a whole stroke.

        Effect:
            The lift is down; the instrument has no way to say so.
        """
        return self._lift(LIFT_DOWN)

    def _lift(self, channel: int) -> Report:
        self.refuse_if_stopped()
        with before_acting():
            self._refuse_fault()
        self._send(f"OUT_SP_{channel} 1")
        # The lift has no command to stop: it goes on to its end whatever happens here.
        self.rest(self.config.lift_s)
        with once_started(lambda: None, dict, driver=self):
            self._refuse_fault()
        return Report(evidence={"waited_s": self.config.lift_s})

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

    def _bath_without_fault(self) -> float:
        self._refuse_fault()
        return self.bath_temperature_c()

    def _refuse_fault(self) -> None:
        state = decode_text(self._exchange("STATUS"))
        if state in FAULTS:
            raise DeviceError(
                f"evaporator reports {state}: {FAULTS[state]}",
                code="device.alarm",
                context={"alarm": state},
            )
        if state not in STATES:
            raise FrameError(f"answer to STATUS is {state!r}")

    def _temperatures(self) -> dict[str, Any]:
        return {
            "bath_temperature_c": self.bath_temperature_c(),
            "bath_setpoint_c": self.bath_setpoint_c(),
        }

    def _speeds(self) -> dict[str, Any]:
        return {"speed_rpm": self.speed_rpm(), "speed_setpoint_rpm": self.speed_setpoint_rpm()}

    def _bath_off(self) -> None:
        self._send(f"STOP_{BATH}")

    def _drive_off(self) -> None:
        self._send(f"STOP_{SPEED}")

    def _set(self, channel: int, value: float) -> None:
        """Write a setpoint and read it back; what already runs follows it at once."""
        self._send(f"OUT_SP_{channel} {value:g}")
        taken = self._value("IN_SP", channel)
        refuse_untaken(f"setpoint {channel}", taken, value, resolution=ROUNDING)

    def _value(self, command: str, channel: int) -> float:
        return decode_value(self._exchange(f"{command}_{channel}"), channel)

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)

    def _send(self, command: str) -> None:
        self.transport.send(encode_line(command))
