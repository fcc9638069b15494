"""What instruments of IKA share: NAMUR lines over a serial port.

Source:
    IKA, operating instructions, section "Interfaces and outputs", NAMUR commands.
"""

from __future__ import annotations

import re

from drivers.transports.base import ByteTransport
from labweb.domain.errors import FrameError, RejectedError

END = b"\r\n"
ROUNDING = 0.6
"""Instruments may round a setpoint to whole units."""


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("OUT_SP_1 60.0")
        b'OUT_SP_1 60.0\r\n'
    """
    return f"{command}\r\n".encode("ascii")


def decode_value(frame: bytes, channel: int) -> float:
    r"""Read a value and make sure that it is of the channel asked for.

    Raises:
        FrameError: Not a value, or of another channel.

    Example:
        >>> decode_value(b"25.3 1\r\n", 1)
        25.3
    """
    match = re.fullmatch(rb"(-?[0-9]{1,6}(?:\.[0-9]{1,4})?) ([0-9]{1,2})\r\n", frame)
    if match is None or int(match[2]) != channel:
        raise FrameError(f"answer is no value of channel {channel}", context={"frame": frame.hex()})
    return float(match[1])


def decode_text(frame: bytes) -> str:
    r"""Read an answer that is a text.

    Raises:
        FrameError: Not printable.

    Example:
        >>> decode_text(b"IKARET \r\n")
        'IKARET'
    """
    if not re.fullmatch(rb"[\x20-\x7e]*\r\n", frame):
        raise FrameError("answer is no text", context={"frame": frame.hex()})
    return frame.decode("ascii").strip()


def refuse_other(transport: ByteTransport, name: str, expected: str) -> None:
    """Refuse another model than the driver is for.

    Raises:
        RejectedError: It has another name.
    """
    if name != expected:
        raise RejectedError(
            f"{transport.line} answers as {name!r}, expected {expected!r}",
            context={"model": name},
        )
