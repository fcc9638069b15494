"""Frames of SpectraMax plate readers: fields that end in `>`, and the table of a reading.

Source:
    Open drivers of the SpectraMax series, which agree (PyLabRobot, Molecular Devices backend; a
    driver of the 384 Plus): commands, fields of answers, errors, and the block of `!TRANSFER`.
    ANSI/SLAS 4-2004 (R2012): where wells are.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from string import ascii_uppercase

from labweb.domain.errors import DeviceError, FrameError, RejectedError

SATURATED = "#SAT"

REASONS = {
    100: "it does not know the command",
    101: "an argument is wrong",
    105: "it is busy",
    106: "it is measuring",
    107: "it has no data",
    110: "stray light: is a door open?",
    111: "the settings do not fit each other",
    300: "its thermistor is faulty",
    301: "it is too hot",
    302: "there is too little light",
    304: "the signal is saturated",
    400: "its carriage did not move as it should",
    402: "its grating did not move as it should",
    403: "its stage did not move as it should",
}
"""What its errors mean, as the open drivers have them."""

FAULTS = frozenset({300, 301, 400, 402, 403})
"""Of these, what it has found while it acted: a part stands where it should not, or is too hot."""

_FAILED = re.compile(r"FAIL\s+([0-9]{1,4})")
_NUMBER = re.compile(r"[+-]?[0-9]{1,3}\.[0-9]{1,6}")


@dataclass(frozen=True, slots=True)
class Plate:
    """A footprint of wells, ANSI/SLAS 4: from the left and from the upper edge."""

    rows: int
    columns: int
    first_x_mm: float
    first_y_mm: float
    pitch_mm: float


def plate_of(wells: str) -> Plate:
    """Return the footprint of a plate with `96` or `384` wells.

    Source:
        ANSI/SLAS 4-2004 (R2012), sections 4.1 and 4.2.
    """
    if wells == "96":
        return Plate(8, 12, 14.38, 11.24, 9.0)
    return Plate(16, 24, 12.13, 8.99, 4.5)


@dataclass(frozen=True, slots=True)
class PlateReading:
    """What one reading of a plate tells."""

    temperature_c: float
    absorbances: dict[int, dict[str, float | None]]
    """By wavelength in nm, by well; None: beyond what the reader can tell."""

    @property
    def saturated_count(self) -> int:
        """Tell how many values are none."""
        return sum(value is None for one in self.absorbances.values() for value in one.values())


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("!STATUS")
        b'!STATUS\r'
    """
    return f"{command}\r".encode("ascii")


def ending(count: int) -> Callable[[bytes], int | None]:
    r"""Return how an answer of so many fields ends; one that tells of a failure ends at once.

    Example:
        >>> ending(2)(b"OK\r\n>OPEN\r\nIDLE\r\n\r\n>"), ending(2)(b"FAIL\t 106\r\n>")
        (20, 12)
    """

    def whole(received: bytes) -> int | None:
        begins = 0
        for _ in range(count):
            ends = received.find(b">", begins)
            if ends < 0:
                return None
            if b"FAIL" in received[begins:ends]:
                return ends + 1
            begins = ends + 1
        return begins

    return whole


def decode_fields(frame: bytes, command: str) -> list[str]:
    r"""Read the fields behind the `OK` of an answer.

    Raises:
        RejectedError: The reader refused (NONE).
        DeviceError: A part of it failed, and may have moved (UNKNOWN).
        FrameError: It is no answer.

    Example:
        >>> decode_fields(b"OK\r\n>OPEN\r\nIDLE\r\n\r\n>", "!STATUS")
        ['OPEN\r\nIDLE']
    """
    try:
        fields = [field.strip() for field in frame.decode("ascii").split(">")[:-1]]
    except UnicodeDecodeError as error:
        raise FrameError("the answer is no text", context={"frame": frame[:200].hex()}) from error
    for field in fields:
        found = _FAILED.fullmatch(field)
        if found is not None:
            code = int(found[1])
            reason = REASONS.get(code, "of a reason that its manual tells")
            text, context = f"{command}: {reason} ({code})", {"code": code}
            if code in FAULTS:
                raise DeviceError(
                    f"the reader failed at {text}", code="device.alarm", context=context
                )
            raise RejectedError(f"the reader refused {text}", context=context)
    if not fields or not re.fullmatch(r"OK(?:\s.*)?", fields[0], re.DOTALL):
        raise FrameError(f"no answer to {command}", context={"frame": frame[:200].hex()})
    return fields[1:]


def decode_reading(text: str, plate: Plate, wavelengths_nm: Sequence[int]) -> PlateReading:
    r"""Read the block of `!TRANSFER`: a head, the wavelengths, then columns for each.

    Raises:
        FrameError: It is of another plate or of other wavelengths, or a value is none.

    Example:
        >>> one = Plate(2, 1, 14.38, 11.24, 9.0)
        >>> decode_reading("12.5\t25.1\tp\nL:\t450\nL:\t450\n1:\t0.1\t#SAT", one, [450]).absorbances
        {450: {'A1': 0.1, 'B1': None}}
    """
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    head = lines[0].split("\t") if lines else []
    if len(head) < 2 or not _is_number(head[1]):
        raise FrameError("the data has no head", context={"text": text[:200]})
    asked = [str(one) for one in wavelengths_nm]
    if len(lines) < 2 or lines[1].split("\t") != ["L:", *asked]:
        raise FrameError("the data is of other wavelengths", context={"line": lines[1:2]})
    absorbances: dict[int, dict[str, float | None]] = {}
    size = plate.columns + 1
    if len(lines) != 2 + size * len(asked):
        raise FrameError(f"the data has {len(lines)} lines", context={"text": text[:200]})
    for index, wavelength in enumerate(wavelengths_nm):
        block = lines[2 + index * size : 2 + (index + 1) * size]
        if block[0].split("\t") != ["L:", str(wavelength)]:
            raise FrameError(f"the data is not of {wavelength} nm", context={"line": block[0]})
        absorbances[wavelength] = dict(_wells(block[1:], plate))
    return PlateReading(float(head[1]), absorbances)


def _wells(lines: Iterable[str], plate: Plate) -> Iterable[tuple[str, float | None]]:
    for number, line in enumerate(lines, start=1):
        name, *values = re.split(r"\s+", line)
        if name != f"{number}:" or len(values) != plate.rows:
            raise FrameError(f"column {number} is not whole", context={"line": line[:200]})
        for row, value in zip(ascii_uppercase, values, strict=False):
            if value != SATURATED and not _is_number(value):
                raise FrameError(f"{row}{number} is {value!r:.40}, no number")
            yield f"{row}{number}", None if value == SATURATED else float(value)


def _is_number(text: str) -> bool:
    return _NUMBER.fullmatch(text) is not None


def render_table(reading: PlateReading) -> bytes:
    """Write a reading as a table with units: format `csv` of `docs/files.md`."""
    heads = [f"absorbance {one} nm (1)" for one in reading.absorbances]
    rows = [
        f"# temperature_c: {reading.temperature_c:g}",
        ",".join(["place (1)", "well (text)", *heads]),
    ]
    first = next(iter(reading.absorbances.values()))
    for number, well in enumerate(first, start=1):
        values = [one[well] for one in reading.absorbances.values()]
        cells = ["" if value is None else f"{value:g}" for value in values]
        rows.append(",".join([str(number), well, *cells]))
    return "\n".join([*rows, ""]).encode("utf-8")
