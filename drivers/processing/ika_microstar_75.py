"""IKA Microstar 75 overhead stirrer.

Protocol: NAMUR, 9600 7E1, text lines CR LF, 0.3 s apart; setters silent, queries value and channel.
Quality: bronze, simulated instrument.
Safe state: motor off; on a lost link it goes on.

It forgets a speed that is set while it stands, so the motor is started first and the speed
set right after; a speed that is not taken stops the motor again.

Source:
    IKA, operating instructions of Microstar 7.5, 15, 30 digital and control, NAMUR commands;
    the order of start and speed as users of open drivers report it.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.stirrer import Stirrer
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

MODEL = "Microstar C"
SPEED, TORQUE = 4, 5
"""Channels."""

ANSWER_S = 1.0
SPEED_TOLERANCE_RPM = 20.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One stirrer."""

    max_speed_rpm: Annotated[float, Range(30.0, 2000.0)] = 2000.0
    speed_limit_s: Annotated[float, Range(0.1, 50.0)] = 30.0
    """Longest time to reach a speed, or to stand."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.5
    gap_s: Annotated[float, Range(0.0, 5.0)] = 0.3
    """Least time between two commands; what comes sooner is lost."""


class IkaMicrostar75(Driver[ByteTransport, Config], Stirrer):
    """One overhead stirrer."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the name, and refuse another model."""
        refuse_other(self.transport, decode_text(self._exchange("IN_NAME")), MODEL)

    def halt(self) -> None:
        """Turn the motor off."""
        self._send(f"STOP_{SPEED}")

    @status(every_s=2.0)
    def speed_rpm(self) -> float:
        """Tell the motor's reading."""
        return self._value("IN_PV", SPEED)

    @status(every_s=4.0)
    def speed_setpoint_rpm(self) -> float:
        """Tell the wanted speed."""
        return self._value("IN_SP", SPEED)

    @status(every_s=4.0)
    def torque_ncm(self) -> float:
        """Tell the torque at the shaft."""
        return self._value("IN_PV", TORQUE)

    @action(timeout_s=60.0, recovery="R1", hazards=("moving_parts",))
    def stir(self, speed_rpm: Annotated[float, Range(30.0, 2000.0)]) -> Report:
        """Stir, and return once the speed is reached.

        Raises:
            DeviceError: Not reached in time, not taken, or stopped: the motor is off again.

        Effect:
            The motor stays on with this setpoint.
        """
        self.refuse_if_stopped()
        refuse_beyond("speed", speed_rpm, 0.0, self.config.max_speed_rpm)
        with before_acting():
            self.speed_rpm()
        with once_started(self.halt, self._speeds, driver=self):
            self._send(f"START_{SPEED}")
            self._send(f"OUT_SP_{SPEED} {round(speed_rpm)}")
            taken = self.speed_setpoint_rpm()
            refuse_untaken("speed", taken, round(speed_rpm), resolution=ROUNDING)
            self._await(speed_rpm)
            return Report(evidence=self._speeds())

    @action(timeout_s=60.0, recovery="R1")
    def stop_stirring(self) -> Report:
        """Turn the motor off, and return once it stands.

        Effect:
            The motor is off.
        """
        self.halt()
        with once_started(self.halt, self._speeds, driver=self):
            self._await(0.0)
            return Report(evidence=self._speeds())

    def _await(self, speed_rpm: float) -> None:
        await_reading(
            self,
            self.speed_rpm,
            WantedReading(speed_rpm, SPEED_TOLERANCE_RPM, "rpm"),
            limit_s=self.config.speed_limit_s,
            poll_s=self.config.poll_s,
            is_stopping=speed_rpm == 0,
        )

    def _speeds(self) -> dict[str, Any]:
        return {"speed_rpm": self.speed_rpm(), "torque_ncm": self.torque_ncm()}

    def _value(self, command: str, channel: int) -> float:
        return decode_value(self._exchange(f"{command}_{channel}"), channel)

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(
            encode_line(command), until=END, timeout_s=ANSWER_S, gap_s=self.config.gap_s
        )

    def _send(self, command: str) -> None:
        self.transport.send(encode_line(command), gap_s=self.config.gap_s)
