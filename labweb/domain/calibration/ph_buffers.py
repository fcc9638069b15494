"""A probe against standard buffers: what their pH is, and what becomes of readings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec

from labweb.domain.calibration.line_fit import Point
from labweb.domain.calibration.ph_buffers_table import BUFFERS
from labweb.domain.errors import Finding, StateError

TEMPERATURE_C = 0.5
"""Standard uncertainty of the buffer's temperature, as the probe tells it."""

RESOLUTION_PH = 0.01
MOST_CARRIED_RATIO = 0.01


class BufferReading(msgspec.Struct, frozen=True, kw_only=True):
    """One reading in one buffer."""

    standard: str
    value_ph: float
    """As the probe told it, raw."""

    temperature_c: float
    expanded: float
    """Of the buffer, by its certificate (k = 2)."""

    at_s: float


def buffer_ph(standard: str, temperature_c: float) -> float:
    """Return the pH of a standard buffer, linear between two temperatures of its table.

    Raises:
        StateError: The table ends before; nothing is extrapolated.

    Example:
        >>> buffer_ph("phthalate", 25.0), round(buffer_ph("phosphate", 22.0), 4)
        (4.005, 6.8746)
    """
    rows = sorted(BUFFERS[standard][1].items())
    for (low_c, low), (high_c, high) in pairwise(rows):
        if low_c <= temperature_c <= high_c:
            return low + (high - low) * (temperature_c - low_c) / (high_c - low_c)
    text = (
        f"the {standard} buffer has {temperature_c:g} °C; its pH is known from {rows[0][0]:g} to "
        f"{rows[-1][0]:g} °C"
    )
    raise StateError(text, code="calibration.buffer_temperature")


def check_filling(*, holds_nl: int, dead_ul: float, volume_ul: float) -> list[Finding]:
    """List why a vessel cannot take one buffer after the other; empty means go.

    What a vessel cannot give is thinned twice before a buffer is read: by the rinse and by the
    filling. More than a hundredth of the buffer before is too much.
    """
    found = []
    if holds_nl:
        text = f"the vessel holds {holds_nl / 1000:g} µL by the record: empty it before"
        found.append(Finding("calibration.not_empty", text, "vessel_id"))
    left = (dead_ul / (dead_ul + volume_ul)) ** 2 if volume_ul > 0 else 1.0
    if left > MOST_CARRIED_RATIO:
        text = (
            f"{dead_ul:g} µL stay in the vessel: {left:.1%} of one buffer would be in the next; "
            "fill more"
        )
        found.append(Finding("calibration.carry_over", text, "volume_ul"))
    return found


def points_of(readings: Sequence[BufferReading]) -> list[Point]:
    """Compare readings with their buffers; a buffer is one level.

    Raises:
        StateError: As `buffer_ph`.
    """
    first: dict[str, float] = {}
    points = []
    for one in readings:
        reference = buffer_ph(one.standard, one.temperature_c)
        level = first.setdefault(one.standard, round(reference, 2))
        beside = one.temperature_c + (TEMPERATURE_C if one.temperature_c < 25 else -TEMPERATURE_C)
        drift = abs(buffer_ph(one.standard, beside) - reference)
        points.append(
            Point(
                level=level,
                indicated=one.value_ph,
                reference=reference,
                standard=math.hypot(one.expanded / 2, drift),
                at_s=one.at_s,
            )
        )
    return points
