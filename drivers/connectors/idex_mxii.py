"""IDEX MX Series II selector valve.

Protocol: UART, 19200 8N1, command and CR; P and two hexadecimal digits turn, S tells the position.
Quality: bronze, simulated instrument.
Safe state: the valve stands at a position; a turn that has begun cannot be stopped.

Source:
    IDEX Health & Science, "UART/I2C communication protocol for TitanHT and MX valves", table of
    commands.
"""

from __future__ import annotations

import re
from typing import Annotated, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, status
from drivers.connectors._motion import refuse_port, turn_valve
from drivers.interfaces.valve import Valve
from drivers.transports.base import ByteTransport
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError

END = b"\r"
ANSWER_S = 1.0
BUSY = "*"
COMMAND_ERROR = "77"
ERRORS = {
    "44": "data checksum error",
    "55": "data integrity error",
    "66": "valve positioning error",
    "77": "valve configuration error or command error",
    "88": "non-volatile memory error",
    "99": "valve cannot be homed",
}


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One valve on its line."""

    ports_count: Annotated[int, Range(2, 24)]
    """Positions of the valve."""


def encode_move(port_index: int) -> bytes:
    r"""Build the frame of a turn.

    Example:
        >>> encode_move(10)
        b'P0A\r'
    """
    return f"P{port_index:02X}\r".encode("ascii")  # table of commands: two hexadecimal digits


def decode_status(frame: bytes) -> int | None:
    r"""Return the position, None while the valve turns.

    Raises:
        DeviceError: The valve reports an error; UNKNOWN.
        FrameError: Not such an answer.

    Example:
        >>> decode_status(b"0A\r"), decode_status(b"*\r")
        (10, None)
    """
    text = frame.decode("ascii", errors="replace").strip()
    if text == BUSY:
        return None
    if text in ERRORS:
        raise DeviceError(
            f"the valve reports {text}: {ERRORS[text]}",
            effect=Effect.UNKNOWN,
            context={"error_code": int(text)},
        )
    if not re.fullmatch(r"[0-9A-F]{2}", text):
        raise FrameError(f"status is told as {text!r}", context={"frame": frame.hex()})
    return int(text, base=16)


class IdexMxii(Driver[ByteTransport, Config], Valve):
    """One valve."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the position. Nothing moves."""
        self._status()

    def halt(self) -> None:
        """Do nothing: the valve cannot be stopped, and ends at a position."""

    @status(every_s=1.0)
    def port_index(self) -> int:
        """Tell the port that is selected, counted from 1."""
        position = self._status()
        if position is None or not 1 <= position <= self.config.ports_count:
            raise RejectedError(
                "the valve turns" if position is None else f"the valve stands at {position}"
            )
        return position

    @action(timeout_s=30.0, recovery="R1")
    def select_port(self, port_index: Annotated[int, Range(1, 24)]) -> Report:
        """Turn to a port, counted from 1, and return once the valve stands there.

        Effect:
            None on matter; what flows next flows through that port.
        """
        self.refuse_if_stopped()
        refuse_port(port_index, self.config.ports_count)
        return turn_valve(
            self,
            port_index,
            begin=lambda: self._go(port_index),
            is_idle=lambda: self._status() is not None,
            where=self.port_index,
        )

    def _go(self, port_index: int) -> None:
        answer = self.transport.exchange(encode_move(port_index), until=END, timeout_s=ANSWER_S)
        text = answer.decode("ascii", errors="replace").strip()
        if text in {BUSY, COMMAND_ERROR}:
            raise RejectedError(f"the valve does not turn: {text}")
        if text not in {"", f"{port_index:02X}"}:
            raise FrameError(f"a turn is answered with {text!r}", context={"frame": answer.hex()})

    def _status(self) -> int | None:
        return decode_status(self.transport.exchange(b"S\r", until=END, timeout_s=ANSWER_S))
