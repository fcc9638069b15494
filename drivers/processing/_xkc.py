"""Frames of a contactless level sensor on a shared RS-485 line: Modbus RTU, function 3.

The bus carries frames of other makers, too, which a Modbus line does not; so the few frames that
the sensor has are built here, on a line of bytes.

Source:
    XKC, Y25 and Y26 series, non-contact level sensor with RS-485, register table; Modbus over
    serial line V1.02, sections 2.5.1 and 6.2; Modbus application protocol V1.1b3, section 7.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from drivers.transports.base import ByteTransport
from labweb.domain.errors import FrameError, RejectedError

READ, EXCEPTION = 0x03, 0x80
OUTPUT, OWN_ADDRESS = 0x0001, 0x0004
"""Registers; that of the signal strength follows the output."""

EXCEPTIONS = {0x01: "illegal function", 0x02: "illegal register address", 0x03: "illegal value"}
POLYNOMIAL, ALL_ONES = 0xA001, 0xFFFF
HEAD, EXCEPTION_LENGTH, CRC_LENGTH, WORD = 3, 5, 2, 2
ANSWER_S = 0.5
GAP_S = 0.005
"""More than the 3.5 characters of silence that end a frame at 9600 baud."""


class LevelReading(NamedTuple):
    """What the sensor tells."""

    has_liquid: bool
    signal: int
    """Signal strength, in counts of its own."""


def crc_of(body: bytes) -> bytes:
    """Return the check of a frame, low byte first.

    Example:
        >>> crc_of(bytes.fromhex("060300010002")).hex()
        '947c'
    """
    crc = ALL_ONES
    for byte in body:
        crc ^= byte
        for _ in range(8):  # Modbus over serial line, section 6.2.2
            crc = crc >> 1 ^ (POLYNOMIAL if crc & 1 else 0)
    return crc.to_bytes(CRC_LENGTH, "little")


def encode_read(address: int, register: int, count: int) -> bytes:
    """Build the request for registers.

    Example:
        >>> encode_read(6, OUTPUT, 2).hex(" ")
        '06 03 00 01 00 02 94 7c'
    """
    body = bytes((address, READ)) + register.to_bytes(WORD, "big") + count.to_bytes(WORD, "big")
    return body + crc_of(body)


def length_of_answer(received: bytes) -> int | None:
    """Tell how long the answer is that has begun to come; None: not known yet.

    Example:
        >>> length_of_answer(bytes.fromhex("060304")), length_of_answer(bytes.fromhex("068302"))
        (9, 5)
    """
    if len(received) < HEAD:
        return None
    return EXCEPTION_LENGTH if received[1] & EXCEPTION else HEAD + received[2] + CRC_LENGTH


def decode_words(frame: bytes, address: int, count: int) -> tuple[int, ...]:
    """Read registers out of an answer.

    Raises:
        RejectedError: The sensor answered with an exception.
        FrameError: Wrong check, another unit, another function, or another number of registers.

    Example:
        >>> decode_words(bytes.fromhex("06030200068d86"), 6, 1)
        (6,)
    """
    body, crc = frame[:-CRC_LENGTH], frame[-CRC_LENGTH:]
    if len(frame) < EXCEPTION_LENGTH or crc_of(body) != crc:
        raise FrameError("answer of the sensor has a wrong check", context={"frame": frame.hex()})
    if body[0] != address:
        raise FrameError(f"unit {body[0]} answers instead of sensor {address}")
    if body[1] == READ | EXCEPTION and len(frame) == EXCEPTION_LENGTH:
        reason = EXCEPTIONS.get(body[2], f"exception {body[2]}")
        raise RejectedError(f"sensor {address} refuses: {reason}", context={"exception": body[2]})
    if body[1] != READ or body[2] != count * WORD or len(body) != HEAD + count * WORD:
        raise FrameError("answer of the sensor to something else", context={"frame": frame.hex()})
    data = body[HEAD:]
    return tuple(int.from_bytes(data[at : at + WORD], "big") for at in range(0, len(data), WORD))


def decode_level(words: tuple[int, ...]) -> LevelReading:
    """Read output and signal strength.

    Raises:
        FrameError: An output that the table does not have.

    Example:
        >>> decode_level((1, 620))
        Level(has_liquid=True, signal=620)
    """
    output, signal = words
    if output not in {0, 1}:
        raise FrameError(f"output of the sensor is {output}", context={"words": list(words)})
    return LevelReading(output == 1, signal)


@dataclass(frozen=True, slots=True)
class LevelSensor:
    """One sensor at one address."""

    transport: ByteTransport
    address: int

    def identify(self) -> None:
        """Ask for its address. Nothing changes.

        Raises:
            RejectedError: It tells another one than it answers at.
        """
        (told,) = self._read(OWN_ADDRESS, 1)
        if told != self.address:
            raise RejectedError(f"sensor {self.address} tells that its address is {told}")

    def level(self) -> LevelReading:
        """Return what stands at it now."""
        return decode_level(self._read(OUTPUT, len(LevelReading._fields)))

    def _read(self, register: int, count: int) -> tuple[int, ...]:
        frame = self.transport.exchange(
            encode_read(self.address, register, count),
            until=length_of_answer,
            timeout_s=ANSWER_S,
            gap_s=GAP_S,
        )
        return decode_words(frame, self.address, count)
