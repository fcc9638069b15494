"""The data block of a furnace behind an S7 controller: 48 bytes, version 1, big-endian.

Source:
    Table of the data block "remote", version 1, that the controller's program has: byte, type, name
    and access of each field, status bits and error numbers.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from labweb.domain.errors import FrameError

LAYOUT = ">ffHHBxHHBxhfffffIH"
"""Bytes 0 to 47; a byte of padding follows each byte that stands alone."""

BLOCK_BYTES = 48
TARGET, WATCHDOG, LIFE, COMMANDS, ORDER = 0, 8, 10, 12, 14
"""Where the fields that are written begin."""

START, STOP, ACKNOWLEDGE = 0x01, 0x02, 0x04
"""Bits of the commands; the controller clears each when it has taken it."""

ON, REACHED, DOOR_OPEN, ERROR, REMOTE, RAMPING = 0x01, 0x02, 0x04, 0x08, 0x10, 0x20
"""Bits of the status."""

ERRORS = {
    1: "the thermocouple is broken",
    2: "over-temperature",
    3: "the door was opened while it was on",
    4: "the start was refused, its target is out of limits",
    5: "the watchdog saw nobody",
    6: "the key switch does not release remote control",
}
VERSION = 1
ORDERS = 0xFFFF


@dataclass(frozen=True, slots=True)
class FurnaceState:
    """The data block, as its bytes have it."""

    target_c: float
    ramp_k_min: float
    watchdog_s: int
    life: int
    commands: int
    order: int
    order_taken: int
    bits: int
    error: int
    reading_c: float
    working_c: float
    output: float
    low_c: float
    high_c: float
    uptime_ms: int
    version: int

    @property
    def is_on(self) -> bool:
        """Tell whether the control is on."""
        return bool(self.bits & ON)

    @property
    def alarm(self) -> str:
        """Say what the controller reports, "" when it reports nothing."""
        if not self.error and not self.bits & ERROR:
            return ""
        return ERRORS.get(self.error, "an error that its table does not have")


def decode_block(data: bytes) -> FurnaceState:
    """Read the data block.

    Raises:
        FrameError: It has another length, or a number is none.

    Example:
        >>> empty = bytes(46) + bytes((0, 1))
        >>> decode_block(empty).version, decode_block(empty).is_on
        (1, False)
    """
    if len(data) != BLOCK_BYTES:
        raise FrameError(f"the block has {len(data)} bytes, {BLOCK_BYTES} were asked for")
    values = struct.unpack(LAYOUT, data)
    if not all(math.isfinite(value) for value in values):
        raise FrameError("a number of the block is none", context={"block": data.hex()})
    return FurnaceState(*values)


def encode_setpoint(target_c: float, ramp_k_min: float, watchdog_s: int) -> bytes:
    """Build bytes 0 to 9.

    Example:
        >>> encode_setpoint(500.0, 5.0, 30).hex()
        '43fa000040a00000001e'
    """
    return struct.pack(">ffH", target_c, ramp_k_min, watchdog_s)
