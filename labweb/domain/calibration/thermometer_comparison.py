"""A heater's own probe against a reference thermometer in the same liquid.

Source:
    Comparison at held set points as in EURAMET Calibration Guide 13 (temperature block
    calibrators); the line by ISO/TS 28037:2010, 6; the uncertainty by JCGM 100:2008.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from labweb.domain.calibration.line_fit import Point

RESOLUTION_C = 0.1
"""Coarsest step in which the instruments that are marked take a set point and tell a reading."""

LEAST_SET_POINTS, MOST_SET_POINTS = 3, 10
"""Two points always fit a line: the third one shows whether there is one."""


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """Both thermometers, at the end of a time in which a set point was held."""

    set_point_c: float
    """True temperature that the workflow asked for: the level."""

    sent_c: float
    """Set point that the device was given for it, in its own numbers."""

    indicated_c: float
    """What its own probe told, raw."""

    reference_c: float
    """What the reference thermometer told, raw."""

    at_s: float
    """When, in seconds from the first."""


def points_of(made: Sequence[Comparison], expanded_c: float) -> list[Point]:
    """Compare own probe and reference; a set point is one level.

    How far the probe stood from the set point that was sent counts as uncertain, evenly spread:
    a step asks for a set point, and the line is of the probe.

    Args:
        made: In the order in which they were made.
        expanded_c: Expanded uncertainty (k = 2) of the reference, by its certificate.

    Example:
        >>> one = Comparison(
        ...     set_point_c=50.0, sent_c=50.0, indicated_c=50.0, reference_c=48.5, at_s=0.0
        ... )
        >>> points_of([one], 0.1)[0].standard
        0.05
    """
    return [
        Point(
            level=one.set_point_c,
            indicated=one.indicated_c,
            reference=one.reference_c,
            standard=math.hypot(expanded_c / 2, (one.sent_c - one.indicated_c) / math.sqrt(3)),
            at_s=one.at_s,
        )
        for one in made
    ]
