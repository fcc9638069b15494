"""The universal actuator of Vici Valco: frames and waiting.

Source:
    Valco Instruments, Technical Note 415, "Serial commands for the universal electric actuator".
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from drivers.base import Driver
from drivers.transports.base import ByteTransport
from labweb.domain.errors import FrameError

END = b"\r"
ANSWER_S = 1.0
_POSITION = re.compile(rb'(?:CP|Position is *= *) *"?([0-9]{1,2}|[AB])"?\s*\Z')


def encode_command(address: str, command: str) -> bytes:
    r"""Build the frame of a command; without an id the only actuator on the line is meant.

    Example:
        >>> encode_command("", "GO4"), encode_command("3", "CP")
        (b'GO4\r', b'3CP\r')
    """
    return f"{address}{command}\r".encode("ascii")


def decode_position(frame: bytes) -> str:
    r"""Read the answer to CP, in the words of either firmware.

    Raises:
        FrameError: Not such an answer.

    Example:
        >>> decode_position(b"CP03\r"), decode_position(b"Position is = 3\r")
        ('3', '3')
    """
    match = _POSITION.search(frame)
    if match is None:
        raise FrameError("answer tells no position", context={"frame": frame.hex()})
    return match[1].decode("ascii").lstrip("0")


@dataclass(frozen=True, slots=True)
class Actuator:
    """One actuator, on behalf of its driver."""

    driver: Driver[ByteTransport, Any]
    address: str

    def position(self) -> str:
        """Return the position: a number, or A and B of a two-position valve."""
        frame = encode_command(self.address, "CP")
        return decode_position(self.driver.transport.exchange(frame, until=END, timeout_s=ANSWER_S))

    def go(self, position: int | str) -> None:
        """Begin to turn; the actuator does not answer."""
        self.driver.transport.send(encode_command(self.address, f"GO{position}"))
