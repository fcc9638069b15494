"""Heidolph overhead stirrers Hei-TORQUE 100 Precision and RZR 2052 control.

Protocol: Heidolph letters, 9600 8N1, CR LF; each command is answered by a word and a number.
Quality: bronze, simulated instrument.
Safe state: motor off; on a lost link it goes on.

Both models know the same letters. They differ in their least speed, and the RZR 2052 has no
name to ask for. The letter that hands control back to the knob is never sent: the stirrer
would turn at the knob's speed at once.

Source:
    Heidolph, instruction manuals of Hei-TORQUE Precision and RZR 2052 control, section
    "Remote control", command tables.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.stirrer import Stirrer
from drivers.transports.base import ByteTransport
from drivers.waiting import WantedReading, await_reading, once_started, refuse_beyond
from labweb.domain.errors import DeviceError, FrameError, RejectedError

END = b"\r\n"
NAMES = {"hei_torque_100": "HT:100P", "rzr_2052": ""}
LEAST_RPM = {"hei_torque_100": 10.0, "rzr_2052": 50.0}
HIGHEST_RPM = 2000.0
NO_FAULT = "No Error!"
ANSWER_S = 1.0
SPEED_TOLERANCE_RPM = 20.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One stirrer."""

    model: Literal["hei_torque_100", "rzr_2052"]
    max_speed_rpm: Annotated[float, Range(10.0, 2000.0)] = 2000.0
    speed_limit_s: Annotated[float, Range(0.1, 50.0)] = 30.0
    """Longest time to reach a speed, or to stand."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.5


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("R0300")
        b'R0300\r\n'
    """
    return f"{command}\r\n".encode("ascii")


def decode_word(frame: bytes, word: str) -> str:
    r"""Read what follows the word of an answer.

    Raises:
        FrameError: Not an answer with this word.

    Example:
        >>> decode_word(b"FLT: No Error!\r\n", "FLT")
        'No Error!'
    """
    match = re.fullmatch(rb"([A-Z]{3}): *([\x20-\x7e]*)\r\n", frame)
    if match is None or match[1].decode("ascii") != word:
        raise FrameError(f"answer has no {word}", context={"frame": frame.hex()})
    return match[2].decode("ascii").strip()


def decode_number(frame: bytes, word: str) -> float:
    r"""Read the whole number that follows the word of an answer.

    Raises:
        FrameError: Not such an answer.

    Example:
        >>> decode_number(b"RPM: 298\r\n", "RPM")
        298.0
    """
    text = decode_word(frame, word)
    if not re.fullmatch(r"-? *[0-9]{1,5}", text):
        raise FrameError(f"{word} is {text!r}, no number", context={"frame": frame.hex()})
    return float(text.replace(" ", ""))


class HeidolphStirrer(Driver[ByteTransport, Config], Stirrer):
    """One overhead stirrer."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the name where the model has one, and for its fault."""
        expected = NAMES[self.config.model]
        if expected:
            name = self._exchange("T").removesuffix(END).decode("ascii", errors="replace").strip()
            if name != expected:
                raise RejectedError(
                    f"{self.transport.line} answers as {name!r}, expected {expected!r}",
                    context={"model": name},
                )
        decode_word(self._exchange("f"), "FLT")

    def halt(self) -> None:
        """Turn the motor off."""
        if decode_number(self._exchange("R0000"), "SET") != 0:
            raise DeviceError("the stirrer did not take the speed 0")

    @status(every_s=1.0)
    def speed_rpm(self) -> float:
        """Tell the motor's reading."""
        return decode_number(self._exchange("r"), "RPM")

    @status(every_s=2.0)
    def speed_setpoint_rpm(self) -> float:
        """Tell the wanted speed."""
        return decode_number(self._exchange("s"), "SET")

    @status(every_s=2.0)
    def torque_ncm(self) -> float:
        """Tell the torque at the shaft."""
        return decode_number(self._exchange("m"), "NCM")

    @action(timeout_s=60.0, recovery="R1", hazards=("moving_parts",))
    def stir(self, speed_rpm: Annotated[float, Range(10.0, 2000.0)]) -> Report:
        """Stir, and return once the speed is reached.

        Raises:
            DeviceError: Not reached in time, a fault of the motor, or stopped: the motor is
                off again (PARTIAL).

        Effect:
            The motor stays on with this setpoint.
        """
        self.refuse_if_stopped()
        least, highest = LEAST_RPM[self.config.model], min(HIGHEST_RPM, self.config.max_speed_rpm)
        refuse_beyond("speed", speed_rpm, least, highest)
        with before_acting():
            self._refuse_fault()
        with once_started(self.halt, self._speeds, driver=self):
            taken = decode_number(self._exchange(f"R{round(speed_rpm):04d}"), "SET")
            if taken != round(speed_rpm):
                raise RejectedError(f"speed is {taken:g} after writing {speed_rpm:g}")
            self._await(speed_rpm)
            return Report(evidence=self._speeds())

    @action(timeout_s=60.0, recovery="R1")
    def stop_stirring(self) -> Report:
        """Turn the motor off, and return once it stands.

        Effect:
            The motor is off.
        """
        with once_started(self.halt, self._speeds, driver=self):
            self.halt()
            self._await(0.0)
            return Report(evidence=self._speeds())

    def _await(self, speed_rpm: float) -> None:
        await_reading(
            self,
            self.speed_rpm if speed_rpm == 0 else self._speed_without_fault,
            WantedReading(speed_rpm, SPEED_TOLERANCE_RPM, "rpm"),
            limit_s=self.config.speed_limit_s,
            poll_s=self.config.poll_s,
            is_stopping=speed_rpm == 0,
        )

    def _speed_without_fault(self) -> float:
        self._refuse_fault()
        return self.speed_rpm()

    def _refuse_fault(self) -> None:
        fault = decode_word(self._exchange("f"), "FLT")
        if fault != NO_FAULT:
            raise DeviceError(
                f"stirrer reports {fault}", code="device.alarm", context={"alarm": fault}
            )

    def _speeds(self) -> dict[str, Any]:
        return {"speed_rpm": self.speed_rpm(), "torque_ncm": self.torque_ncm()}

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)
