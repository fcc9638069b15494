"""Frames of a GRBL 1.1 controller: lines, status reports, error and alarm codes.

Source:
    Grbl v1.1 wiki: "Interface" (status reports, real-time commands), and the tables of error and
    alarm codes; RS274/NGC for G21, G53, G90 and G1.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from labweb.domain.errors import DeviceError, FrameError, RejectedError

ASK, HOLD, RESET = b"?", b"!", b"\x18"
HOME, IDENTIFY, SETTINGS = "$H", "$I", "$$"
VERSION = "[VER:1.1"
STANDING = frozenset({"Idle", "Alarm", "Sleep", "Check", "Door"})
ERRORS = {
    1: "a letter was expected",
    2: "a number is none",
    3: "the $ command is not supported",
    5: "homing is switched off ($22)",
    8: "the $ command needs a controller that is idle",
    9: "the controller is locked",
    15: "the move is beyond the soft limits",
    20: "the G-code command is not supported",
    22: "the feed rate is missing",
    33: "the target of the move is invalid",
}
ALARMS = {
    1: "a hard limit was hit, the position is lost",
    2: "the move is beyond the soft limits",
    3: "it was reset while it moved, the position is lost",
    8: "homing did not clear the limit switch",
    9: "homing did not find the limit switch",
}
S_PER_MIN = 60.0
END = re.compile(rb"(?:\A|\n)(?:ok|error:[0-9]+|ALARM:[0-9]+)\r\n")
REPORT = re.compile(
    rb"<([A-Z][a-z]+)(?::([0-9]))?\|MPos:(-?[0-9]+\.[0-9]+),(-?[0-9]+\.[0-9]+),(-?[0-9]+\.[0-9]+)"
    rb"(?:\|[A-Z][A-Za-z]*:[^|<>\r\n]*)*?\|FS:([0-9.]+),[0-9.]+(?:\|[A-Z][A-Za-z]*:[^|<>\r\n]*)*>\r\n"
)

Position = tuple[float, float, float]
"""x, y and z in machine coordinates, mm."""


@dataclass(frozen=True, slots=True)
class GrblStatus:
    """A status report."""

    state: str
    step: str
    """Digit behind Hold and Door: 0 where everything stands; "" without one."""

    place_mm: Position
    feed: float

    @property
    def has_stopped(self) -> bool:
        """Tell whether a hold is complete."""
        return self.state == "Hold" and (self.step == "0" or (not self.step and self.feed == 0))


def encode_move(place_mm: Position, speed_mm_s: float) -> str:
    """Write a straight move to a place in machine coordinates.

    Example:
        >>> encode_move((-10.0, -20.5, 0.0), 10.0)
        'G21 G90 G53 G1 X-10.000 Y-20.500 Z0.000 F600.0'
    """
    x, y, z = place_mm
    return f"G21 G90 G53 G1 X{x:.3f} Y{y:.3f} Z{z:.3f} F{speed_mm_s * S_PER_MIN:.1f}"


def decode_report(frame: bytes) -> GrblStatus:
    r"""Read a status report.

    Raises:
        FrameError: It is none, or tells no place in machine coordinates.

    Example:
        >>> decode_report(b"<Hold:0|MPos:1.000,-2.500,0.000|FS:0,0>\r\n").place_mm
        (1.0, -2.5, 0.0)
    """
    found = REPORT.fullmatch(frame)
    if found is None:
        raise FrameError("no status report with MPos and FS", context={"frame": frame.hex()})
    state, step, x, y, z, feed = found.groups(default=b"")
    try:
        place = (float(x), float(y), float(z))
        return GrblStatus(state.decode("ascii"), step.decode("ascii"), place, float(feed))
    except ValueError as error:
        raise FrameError(
            "a number of the report is none", context={"frame": frame.hex()}
        ) from error


def decode_answer(frame: bytes) -> list[str]:
    r"""Read the lines before the ok.

    Raises:
        FrameError: Not text.
        RejectedError: error:N, the controller did nothing.
        DeviceError: ALARM:N, the controller is locked now.

    Example:
        >>> decode_answer(b"$22=1\r\n$130=200.000\r\nok\r\n")
        ['$22=1', '$130=200.000']
    """
    if not re.fullmatch(rb"(?:[\x20-\x7e]*\r\n)+", frame):
        raise FrameError("answer is no text", context={"frame": frame.hex()})
    *lines, end = [line for line in frame.decode("ascii").split("\r\n") if line]
    word, _, number = end.partition(":")
    if word == "error":
        why = ERRORS.get(int(number), "an error that this driver does not know")
        raise RejectedError(f"the controller answers {end}: {why}", context={"error": int(number)})
    if word == "ALARM":
        raise _alarm(int(number))
    return [line for line in lines if line != "ok"]


def _alarm(number: int) -> DeviceError:
    why = ALARMS.get(number, "an alarm that this driver does not know")
    return DeviceError(
        f"the controller went into ALARM:{number}: {why}",
        code="device.alarm",
        context={"alarm": number},
    )


def decode_settings(lines: list[str]) -> dict[int, float]:
    """Read the settings by their numbers.

    Raises:
        FrameError: A line is none.

    Example:
        >>> decode_settings(["$22=1", "$130=200.000"])
        {22: 1.0, 130: 200.0}
    """
    found = [re.fullmatch(r"\$([0-9]{1,3})=(-?[0-9]+(?:\.[0-9]+)?)", line) for line in lines]
    if not all(found):
        raise FrameError("the settings cannot be read", context={"settings": lines})
    return {int(one[1]): float(one[2]) for one in found if one is not None}


def is_refusal(frame: bytes) -> bool:
    r"""Tell whether an answer says that nothing was done.

    Example:
        >>> is_refusal(b"error:5\r\n"), is_refusal(b"ALARM:9\r\n")
        (True, False)
    """
    return re.search(rb"(?:\A|\n)error:[0-9]+\r\n\Z", frame) is not None
