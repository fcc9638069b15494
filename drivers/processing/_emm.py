"""Frames of closed-loop stepper motors with ZDT's Emm firmware, and one such motor on a bus.

A frame is address, function, data and a fixed last byte; numbers go high byte first. A motor
answers only what is addressed to it, so several share a line with other things.

Source:
    ZDT (Zhangdatou), Emm_V5.0 closed-loop stepper motor, user manual: section on the serial
    protocol, with its commands to move, to read and to set; bus, addresses and roles as the
    public device file `unilabos/devices/separator/chinwe.py` of Uni-Lab-OS has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from drivers.transports.base import ByteTransport
from labweb.domain.errors import FrameError, RejectedError

CHECK = 0x6B
"""Last byte of every frame."""

ENABLE, ENABLE_MARK = 0xF3, 0xAB
TURN, GO_TO = 0xF6, 0xFD
STOP, STOP_MARK = 0xFE, 0x98
CLEAR_STALL, CLEAR_MARK = 0x0E, 0x52
SET_ZERO, ZERO_MARK = 0x0A, 0x6D
VERSION, SPEED, POSITION, STATUS = 0x1F, 0x35, 0x36, 0x3A
DIRECTIONS: Mapping[str, int] = {"CW": 0x00, "CCW": 0x01}
Direction = Literal["CW", "CCW"]
ABSOLUTE, AT_ONCE = 0x01, 0x00
"""Mode of a move by position, and its sync byte: nobody waits for another motor."""

ACCEPTED, NOT_MET, UNKNOWN_COMMAND, ERROR = 0x02, 0xE2, 0xEE, 0x00
"""Answers to a command; an error has function 0 and the code of the unknown command."""

LENGTHS: Mapping[int, int] = {VERSION: 5, SPEED: 6, POSITION: 8, STATUS: 4}
"""Bytes of the answer to a question; that to a command has four."""

SHORT = 4
FIRMWARE, HARDWARE = 0xF4, 0x78
"""What this table holds for: Emm42_V5.0.0 on ZDT_X42_V1.2."""

IS_ENABLED, HAS_STALLED, IS_PROTECTED = 0x01, 0x04, 0x08
COUNTS_PER_TURN, PULSES_PER_TURN = 65_536, 3200
TOP_SPEED_RPM = 3000
ANSWER_S = 0.5
GAP_S = 0.005
"""Silence between two frames, by which a Modbus unit of the same bus tells them apart."""


def encode_frame(address: int, function: int, data: bytes = b"") -> bytes:
    """Build a frame.

    Example:
        >>> encode_frame(4, STATUS).hex(" ")
        '04 3a 6b'
    """
    return bytes((address, function)) + data + bytes((CHECK,))


def encode_enable(address: int) -> bytes:
    """Build the frame that lets a motor hold and move.

    Example:
        >>> encode_enable(5).hex(" ")
        '05 f3 ab 01 00 6b'
    """
    return encode_frame(address, ENABLE, bytes((ENABLE_MARK, 1, AT_ONCE)))


def encode_turn(address: int, direction: str, speed_rpm: int, acceleration: int) -> bytes:
    """Build the frame that lets a motor turn on and on.

    Example:
        >>> encode_turn(4, "CCW", 300, 200).hex(" ")
        '04 f6 01 01 2c c8 00 6b'
    """
    return encode_frame(
        address,
        TURN,
        bytes((DIRECTIONS[direction],))
        + speed_rpm.to_bytes(2, "big")  # manual, speed mode: two bytes
        + bytes((acceleration, AT_ONCE)),
    )


def encode_move(address: int, direction: str, speed_rpm: int, pulses: int) -> bytes:
    """Build the frame that sends a motor to a place, counted from its zero, without a ramp.

    Example:
        >>> encode_move(5, "CW", 30, 800).hex(" ")
        '05 fd 00 00 1e 00 00 00 03 20 01 00 6b'
    """
    return encode_frame(
        address,
        GO_TO,
        bytes((DIRECTIONS[direction],))
        + speed_rpm.to_bytes(2, "big")  # manual, position mode: two bytes
        + bytes((0,))
        + pulses.to_bytes(4, "big")  # manual, position mode: four bytes
        + bytes((ABSOLUTE, AT_ONCE)),
    )


def encode_stop(address: int) -> bytes:
    """Build the frame that stops a motor at once.

    Example:
        >>> encode_stop(4).hex(" ")
        '04 fe 98 00 6b'
    """
    return encode_frame(address, STOP, bytes((STOP_MARK, AT_ONCE)))


def length_of_answer(received: bytes, function: int) -> int | None:
    """Tell how long the answer is that has begun to come; None: not known yet.

    Example:
        >>> length_of_answer(bytes.fromhex("0536"), POSITION)
        8
        >>> length_of_answer(bytes.fromhex("0500"), POSITION)
        4
    """
    if len(received) < 2:  # table: address and function
        return None
    return SHORT if received[1] == ERROR else LENGTHS.get(function, SHORT)


def decode_answer(frame: bytes, address: int, function: int) -> bytes:
    """Return the data of an answer.

    Raises:
        RejectedError: The motor knows no such command or parameter.
        FrameError: Another length or last byte, another address, or another function.

    Example:
        >>> decode_answer(bytes.fromhex("043a036b"), 4, STATUS).hex()
        '03'
    """
    if len(frame) < SHORT or len(frame) != length_of_answer(frame, function):
        raise FrameError("answer of a wrong length", context={"frame": frame.hex()})
    if frame[-1] != CHECK:
        raise FrameError("answer has a wrong last byte", context={"frame": frame.hex()})
    if frame[0] != address:
        raise FrameError(f"unit {frame[0]} answers instead of motor {address}")
    if frame[1:-1] == bytes((ERROR, UNKNOWN_COMMAND)):
        raise RejectedError(f"motor {address} does not know command {function:#04x}, or its data")
    if frame[1] != function:
        raise FrameError(
            f"motor {address} answers another command than {function:#04x}",
            context={"frame": frame.hex()},
        )
    return frame[2:-1]


def decode_taken(frame: bytes, address: int, function: int) -> None:
    """Make sure that a command was taken.

    Raises:
        RejectedError: Its condition is not met, or it is not known; by the manual nothing moved.
        FrameError: As `decode_answer`, or a status that the manual does not have.

    Example:
        >>> decode_taken(bytes.fromhex("05fd026b"), 5, GO_TO)
    """
    state = decode_answer(frame, address, function)[0]
    if state == NOT_MET:
        raise RejectedError(
            f"motor {address} does not take command {function:#04x}: it is not enabled, or its "
            "stall protection has struck",
            context={"status": state},
        )
    if state != ACCEPTED:
        raise FrameError(f"motor {address} answers with status {state:#04x}")


def decode_signed(data: bytes) -> int:
    """Read a number behind its sign.

    Raises:
        FrameError: A sign that the manual does not have.

    Example:
        >>> decode_signed(bytes.fromhex("0100004000"))
        -16384
    """
    if data[0] not in {0, 1}:  # table: 01 is negative
        raise FrameError(f"{data[0]:#04x} is no sign", context={"data": data.hex()})
    size = int.from_bytes(data[1:], "big")
    return -size if data[0] else size


@dataclass(frozen=True, slots=True)
class Motor:
    """One motor at one address."""

    transport: ByteTransport
    address: int

    def identify(self) -> None:
        """Ask for the versions. Nothing moves.

        Raises:
            RejectedError: Others than those that this table holds for.
        """
        found = self._ask(VERSION)
        if found != bytes((FIRMWARE, HARDWARE)):
            raise RejectedError(
                f"motor {self.address} has firmware {found[0]:#04x} on hardware {found[1]:#04x}: "
                f"known is {FIRMWARE:#04x} on {HARDWARE:#04x}",
                context={"versions": found.hex()},
            )

    def status(self) -> int:
        """Return the flags."""
        return self._ask(STATUS)[0]

    def speed_rpm(self) -> int:
        """Return the speed; its sign is that of the direction."""
        return decode_signed(self._ask(SPEED))

    def position(self) -> int:
        """Return the place, in counts from its zero."""
        return decode_signed(self._ask(POSITION))

    def enable(self) -> None:
        """Let it hold and move; it stands."""
        self._tell(ENABLE, encode_enable(self.address))

    def turn(self, direction: Direction, speed_rpm: int, acceleration: int) -> None:
        """Let it turn on and on."""
        self._tell(TURN, encode_turn(self.address, direction, speed_rpm, acceleration))

    def go_to(self, direction: Direction, speed_rpm: int, pulses: int) -> None:
        """Send it to a place, counted from its zero."""
        self._tell(GO_TO, encode_move(self.address, direction, speed_rpm, pulses))

    def stop(self) -> None:
        """Stop it at once."""
        self._tell(STOP, encode_stop(self.address))

    def clear_stall(self) -> None:
        """End a stall protection that has struck; it stands."""
        self._tell(CLEAR_STALL, encode_frame(self.address, CLEAR_STALL, bytes((CLEAR_MARK,))))

    def set_zero(self) -> None:
        """Let the place where it stands be its zero; it stands."""
        self._tell(SET_ZERO, encode_frame(self.address, SET_ZERO, bytes((ZERO_MARK,))))

    def _tell(self, function: int, frame: bytes) -> None:
        decode_taken(self._exchange(function, frame), self.address, function)

    def _ask(self, function: int) -> bytes:
        frame = self._exchange(function, encode_frame(self.address, function))
        return decode_answer(frame, self.address, function)

    def _exchange(self, function: int, frame: bytes) -> bytes:
        return self.transport.exchange(
            frame,
            until=lambda received: length_of_answer(received, function),
            timeout_s=ANSWER_S,
            gap_s=GAP_S,
        )
