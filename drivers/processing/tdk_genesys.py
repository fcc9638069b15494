"""TDK-Lambda Genesys programmable supply.

Protocol: Genesys text lines, 9600 8N1, CR; a supply answers once it was addressed.
Quality: bronze, simulated instrument.
Safe state: output off; on a lost link it goes on.

Several supplies may share a line, and one that lost its power has forgotten that it was
addressed: each command is sent together with the address.

Source:
    TDK-Lambda, Genesys user manual, chapter "RS232 and RS485 remote control".
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.power_supply import PowerSupply
from drivers.transports.base import ByteTransport
from drivers.waiting import once_started, refuse_beyond, refuse_untaken
from labweb.domain.errors import DeviceError, FrameError, RejectedError

END = b"\r"
MODEL = re.compile(r"LAMBDA, *GEN[0-9]", re.IGNORECASE)
TAKEN = re.compile(r"OK|[A-Z ]+ SET TO: *-?[0-9.]+")
"""What a setter is answered with: OK by supplies, the value by some of their emulators."""

RESOLUTION_V, RESOLUTION_MA = 0.01, 10.0
MA_PER_A = 1000.0
ANSWER_S = 1.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One supply on its line."""

    max_voltage_v: Annotated[float, Range(0.0, 600.0)]
    """Highest voltage that this lab allows."""

    max_current_ma: Annotated[float, Range(0.0, 400_000.0)]
    """Highest current that this lab allows."""

    address_index: Annotated[int, Range(0, 30)] = 6
    settle_s: Annotated[float, Range(0.0, 30.0)] = 0.5
    """Time between turning on and measuring."""


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("PV 1.82")
        b'PV 1.82\r'
    """
    return f"{command}\r".encode("ascii")


def decode_text(frame: bytes) -> str:
    r"""Read an answer as text.

    Raises:
        FrameError: Not printable.

    Example:
        >>> decode_text(b"OK\r")
        'OK'
    """
    if not re.fullmatch(rb"\n?[\x20-\x7e]+\r", frame):
        raise FrameError("answer is no text", context={"frame": frame.hex()})
    return frame.decode("ascii").strip()


def decode_number(text: str) -> float:
    """Read an answer as a number.

    Raises:
        FrameError: Not a number.

    Example:
        >>> decode_number("01.820")
        1.82
    """
    if not re.fullmatch(r"-?[0-9]{1,4}(\.[0-9]{1,5})?", text):
        raise FrameError(f"answer is {text!r}, no number")
    return float(text)


class TdkGenesys(Driver[ByteTransport, Config], PowerSupply):
    """One supply."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the name, and refuse another series."""
        name = self._ask("IDN?")
        if not MODEL.match(name):
            raise RejectedError(
                f"{self.transport.line} answers as {name!r}, expected a Genesys supply",
                context={"model": name},
            )

    def halt(self) -> None:
        """Turn the output off."""
        self._set("OUT OFF")
        if self._is_on():
            raise DeviceError("the output is still on")

    @status(every_s=1.0)
    def voltage_v(self) -> float:
        """Tell the voltage at the terminals."""
        return decode_number(self._ask("MV?"))

    @status(every_s=1.0)
    def current_ma(self) -> float:
        """Tell the current that flows."""
        return round(decode_number(self._ask("MC?")) * MA_PER_A, 6)

    @status(every_s=2.0)
    def voltage_setpoint_v(self) -> float:
        """Tell the wanted voltage."""
        return decode_number(self._ask("PV?"))

    @status(every_s=2.0)
    def current_setpoint_ma(self) -> float:
        """Tell the limit of current."""
        return round(decode_number(self._ask("PC?")) * MA_PER_A, 6)

    @action(timeout_s=60.0, recovery="R1", hazards=("electricity",))
    def supply(
        self,
        voltage_v: Annotated[float, Range(0.0, 600.0)],
        current_ma: Annotated[float, Range(0.0, 400_000.0)],
    ) -> Report:
        """Turn the output on with a voltage and a limit of current, and measure both.

        Raises:
            DeviceError: A setpoint was not taken, a fault, or stopped: the output is off
                again (PARTIAL).

        Effect:
            The output stays on with these setpoints.
        """
        self.refuse_if_stopped()
        refuse_beyond("voltage", voltage_v, 0.0, self.config.max_voltage_v)
        refuse_beyond("current", current_ma, 0.0, self.config.max_current_ma)
        with before_acting():
            self.voltage_v()
        with once_started(self.halt, self._evidence, driver=self):
            self._set("RMT 1")
            self._set(f"PV {voltage_v:.3f}")
            self._set(f"PC {current_ma / MA_PER_A:.3f}")
            taken_v, taken_ma = self.voltage_setpoint_v(), self.current_setpoint_ma()
            refuse_untaken("voltage", taken_v, voltage_v, resolution=RESOLUTION_V)
            refuse_untaken("current", taken_ma, current_ma, resolution=RESOLUTION_MA)
            self._set("OUT ON")
            self.pause(self.config.settle_s)
            if not self._is_on():
                raise DeviceError("the output went off by itself", code="device.alarm")
            return Report(evidence=self._evidence())

    @action(timeout_s=30.0, recovery="R1")
    def stop_supply(self) -> Report:
        """Turn the output off.

        Effect:
            No current flows.
        """
        with once_started(self.halt, self._evidence, driver=self):
            self.halt()
            return Report(evidence=self._evidence())

    def _is_on(self) -> bool:
        answer = self._ask("OUT?")
        if answer not in {"ON", "OFF", "1", "0"}:
            raise FrameError(f"answer to OUT? is {answer!r}")
        return answer in {"ON", "1"}

    def _evidence(self) -> dict[str, Any]:
        return {
            "voltage_v": self.voltage_v(),
            "current_ma": self.current_ma(),
            "is_on": self._is_on(),
        }

    def _set(self, command: str) -> None:
        if not TAKEN.fullmatch(answer := self._ask(command)):
            raise RejectedError(f"{command} was answered with {answer!r}")

    def _ask(self, command: str) -> str:
        with self.transport.lock:
            addressed = self._exchange(f"ADR {self.config.address_index}")
            if addressed != "OK":
                raise FrameError(f"the address was answered with {addressed!r}")
            return self._exchange(command)

    def _exchange(self, command: str) -> str:
        frame = self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)
        return decode_text(frame)
