"""From points to a result: the fit, its residuals, its uncertainty, and what speaks against it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from statistics import fmean, stdev

import msgspec

from labweb.domain.calibration.correction import (
    COVERAGE_FACTOR,
    DIGITS,
    IS_RELATIVE,
    SYMBOLS,
    CalibrationQuantity,
    CorrectionLevel,
)
from labweb.domain.calibration.line_fit import FittedLine, Point, fit_gain, fit_line
from labweb.domain.errors import Finding

NERNST_MV = 59.16
"""Millivolts of one pH at 25 °C: R T ln 10 / F."""

SLOPE_PCT = (92.0, 102.0)
"""Slope of a usable electrode, of the Nernst slope."""

MOST_OFFSET_MV = 30.0
"""Offset of a usable electrode at pH 7."""

GAIN = (0.9, 1.1)
"""Beyond, a pump is not a little wrong: it has another syringe than its settings say."""

MOST_ERROR_C = 10.0
"""Beyond, a probe is not a little wrong: it is broken, or stands in another liquid."""

SPAN_RATIO = 0.9
"""The highest level of a pump is at least this share of its scale."""

_T_95 = (12.71, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228)
"""Student's t for 95 % by degrees of freedom, from 1: JCGM 100:2008, table G.2."""


class Criteria(msgspec.Struct, frozen=True, kw_only=True):
    """What a calibration has to reach to be accepted."""

    tolerance: float
    """Largest expanded uncertainty at any level: a share for a volume, else in the unit."""

    least_levels: int
    least_repeats: int
    full_scale: float | None = None
    """Device's number at its full scale, of a pump."""

    resolution: float = 0.0
    """Smallest difference that the device can make or tell, in its own numbers."""


class LevelResult(msgspec.Struct, frozen=True, kw_only=True):
    """What came out at one level."""

    level: float
    count: int
    indicated: float
    """Mean of the device's numbers."""

    reference: float
    """Mean of the true values."""

    error: float
    """How far the device was off as found: indicated less true."""

    residual: float
    """How far it is off after the correction: true by the fit less true by the reference."""

    repeatability: float
    """Standard deviation of one value."""

    expanded: float
    """Expanded uncertainty (k = 2) of one corrected value."""


class CalibrationOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """What a calibration found. With a finding it cannot be accepted."""

    quantity: CalibrationQuantity
    gain: float
    offset: float
    gain_expanded: float
    offset_expanded: float
    covariance: float
    levels: tuple[LevelResult, ...]
    slope_pct: float | None = None
    """Of an electrode: its slope, as a share of the Nernst slope in percent."""

    offset_mv: float | None = None
    """Of an electrode: its offset at pH 7."""

    findings: tuple[Finding, ...] = ()

    def certified(self) -> tuple[CorrectionLevel, ...]:
        """Return how sure a corrected value is, by true value."""
        return tuple(
            CorrectionLevel(
                value=round(self.offset + self.gain * one.indicated, DIGITS), expanded=one.expanded
            )
            for one in self.levels
        )


def judge(
    quantity: CalibrationQuantity,
    points: Sequence[Point],
    criteria: Criteria,
    *,
    others: Iterable[Finding] = (),
) -> CalibrationOutcome | list[Finding]:
    """Fit the points and list all that speaks against the result.

    Args:
        quantity: What was calibrated.
        points: Comparisons with the reference, in the order in which they were made.
        criteria: What has to be reached.
        others: Findings of the way in which the points were made.

    Returns:
        The result with its findings; findings alone where the points give no fit at all.
    """
    found = [*others, *_check_enough(points, criteria)]
    if any(one.code == "calibration.too_few_points" for one in found):
        return found
    line = fit_gain(points) if quantity is CalibrationQuantity.VOLUME else fit_line(points)
    levels = tuple(
        _level(line, at, [point for point in points if point.level == at], criteria)
        for at in sorted({point.level for point in points})
    )
    found += _check_order(levels)
    if quantity is CalibrationQuantity.VOLUME:
        found += _check_pump(line, points, levels, criteria)
    if quantity is CalibrationQuantity.TEMPERATURE:
        found += _check_probe(levels, criteria)
    found += _check_drift(quantity, line, points, criteria)
    found += _check_uncertainty(quantity, levels, criteria)
    slope_pct = offset_mv = None
    if quantity is CalibrationQuantity.PH:
        slope_pct, offset_mv = _electrode(line)
        found += _check_electrode(slope_pct, offset_mv)
    return CalibrationOutcome(
        quantity=quantity,
        gain=round(line.gain, 9),
        offset=round(line.offset, 9),
        gain_expanded=COVERAGE_FACTOR * math.sqrt(line.gain_variance),
        offset_expanded=COVERAGE_FACTOR * math.sqrt(line.offset_variance),
        covariance=line.covariance,
        levels=levels,
        slope_pct=slope_pct,
        offset_mv=offset_mv,
        findings=tuple(found),
    )


def _level(
    line: FittedLine, level: float, points: Sequence[Point], criteria: Criteria
) -> LevelResult:
    indicated = fmean(point.indicated for point in points)
    reference = fmean(point.reference for point in points)
    rests = [point.reference - line.at(point.indicated) for point in points]
    repeatability = stdev(rests) if len(rests) > 1 else line.scatter
    freedom = len(rests) - 1 if len(rests) > 1 else line.freedom
    residual = -fmean(rests)
    parts = (
        repeatability * _T_95[min(freedom, len(_T_95)) - 1] / COVERAGE_FACTOR,
        max(point.standard for point in points),
        line.standard_at(indicated),
        abs(residual) / math.sqrt(3),
        line.gain * criteria.resolution / 2 / math.sqrt(3),
    )
    return LevelResult(
        level=level,
        count=len(points),
        indicated=round(indicated, DIGITS),
        reference=round(reference, DIGITS),
        error=round(indicated - reference, DIGITS),
        residual=round(residual, DIGITS),
        repeatability=round(repeatability, DIGITS),
        expanded=round(COVERAGE_FACTOR * math.hypot(*parts), DIGITS),
    )


def _check_enough(points: Sequence[Point], criteria: Criteria) -> list[Finding]:
    code = "calibration.too_few_points"
    counts: dict[float, int] = {}
    for point in points:
        counts[point.level] = counts.get(point.level, 0) + 1
    found = []
    if len(counts) < criteria.least_levels:
        text = f"{len(counts)} levels were measured; {criteria.least_levels} are needed"
        found.append(Finding(code, text))
    for level, count in sorted(counts.items()):
        if count < criteria.least_repeats:
            text = f"level {level:g} was measured {count} times; {criteria.least_repeats} needed"
            found.append(Finding(code, text))
    if any(point.indicated <= 0 for point in points) and criteria.full_scale is not None:
        found.append(Finding(code, "a stroke of nothing was weighed: it says nothing of the gain"))
    return found


def _check_order(levels: Sequence[LevelResult]) -> list[Finding]:
    return [
        Finding(
            "calibration.not_monotone",
            f"at level {high.level:g} the reference says {high.reference:g}, not more than "
            f"{low.reference:g} at level {low.level:g}",
        )
        for low, high in pairwise(levels)
        if high.reference <= low.reference or high.indicated <= low.indicated
    ]


def _check_pump(
    line: FittedLine, points: Sequence[Point], levels: Sequence[LevelResult], criteria: Criteria
) -> list[Finding]:
    found = []
    if not GAIN[0] <= line.gain <= GAIN[1]:
        text = (
            f"the pump moves {line.gain:.1%} of what it is told: look at its syringe and its "
            "settings; so large an error is not corrected"
        )
        found.append(Finding("calibration.gain", text))
    highest = max(point.indicated for point in points)
    if criteria.full_scale is not None and highest < SPAN_RATIO * criteria.full_scale:
        text = (
            f"the largest stroke was {highest:g} µL of {criteria.full_scale:g} µL: the full stroke "
            "has to be weighed, since nothing is extrapolated"
        )
        found.append(Finding("calibration.span", text))
    free = fit_line(points)
    lost = criteria.tolerance * levels[0].reference
    if abs(free.offset) > max(lost, 3 * math.sqrt(free.offset_variance)):
        text = (
            f"every stroke is off by {free.offset:.3g} µL whatever its volume: a leak, a bubble or "
            "play in the drive, which a gain does not correct"
        )
        found.append(Finding("calibration.offset", text))
    return found


def _check_probe(levels: Sequence[LevelResult], criteria: Criteria) -> list[Finding]:
    """List what a line does not correct; half of what is wanted may be left at a level."""
    found = []
    for one in levels:
        if abs(one.error) > MOST_ERROR_C:
            text = (
                f"at {one.level:g} °C the probe is off by {one.error:.3g} K: see that both "
                "thermometers stand in the same liquid; so large an error is not corrected"
            )
            found.append(Finding("calibration.probe", text))
        if abs(one.residual) > criteria.tolerance / 2:
            text = (
                f"at {one.level:g} °C {one.residual:.3g} K are left after the correction: the "
                "probe is not off by a slope and an offset, which is all that is corrected"
            )
            found.append(Finding("calibration.not_linear", text))
    return found


def _check_drift(
    quantity: CalibrationQuantity, line: FittedLine, points: Sequence[Point], criteria: Criteria
) -> list[Finding]:
    lasted_s = max(p.at_s for p in points) - min(p.at_s for p in points)
    if not lasted_s or len(points) < 4:
        return []
    is_share = IS_RELATIVE[quantity]
    trend = fit_line(
        [
            Point(
                level=0,
                indicated=point.at_s,
                reference=(point.reference - line.at(point.indicated))
                / (point.reference if is_share else 1.0),
                standard=0,
            )
            for point in points
        ]
    )
    drifted = trend.gain * lasted_s
    is_sure = abs(trend.gain) > 3 * math.sqrt(trend.gain_variance)
    if abs(drifted) <= criteria.tolerance or not is_sure:
        return []
    told = f"{drifted:.2%}" if is_share else f"{drifted:.3g} {SYMBOLS[quantity]}"
    text = f"the values drifted by {told} from the first to the last: wait until they stand, repeat"
    return [Finding("calibration.drift", text)]


def _check_uncertainty(
    quantity: CalibrationQuantity, levels: Sequence[LevelResult], criteria: Criteria
) -> list[Finding]:
    found = []
    for one in levels:
        is_share = IS_RELATIVE[quantity]
        reached = one.expanded / one.reference if is_share else one.expanded
        if reached > criteria.tolerance:
            texts = [as_text(quantity, value) for value in (reached, criteria.tolerance)]
            text = f"at level {one.level:g} the uncertainty is {texts[0]}; {texts[1]} was asked for"
            found.append(Finding("calibration.uncertainty", text))
    return found


def as_text(quantity: CalibrationQuantity, expanded: float) -> str:
    """Write an expanded uncertainty as it is asked for: a share in percent, else in its unit.

    Example:
        >>> as_text(Quantity.VOLUME, 0.005), as_text(Quantity.TEMPERATURE, 0.25)
        ('0.5 %', '0.25 °C')
    """
    if IS_RELATIVE[quantity]:
        return f"{expanded * 100:.3g} %"
    return f"{expanded:.3g} {SYMBOLS[quantity]}"


def _electrode(line: FittedLine) -> tuple[float, float]:
    """Return the slope in percent of Nernst, and the offset at pH 7 in millivolts."""
    slope = 1 / line.gain if line.gain else math.inf
    return 100 * slope, ((7 - line.offset) * slope - 7) * NERNST_MV


def _check_electrode(slope_pct: float, offset_mv: float) -> list[Finding]:
    found = []
    if not SLOPE_PCT[0] <= slope_pct <= SLOPE_PCT[1]:
        text = (
            f"the electrode's slope is {slope_pct:.1f} % of Nernst; usable is {SLOPE_PCT[0]:g} to "
            f"{SLOPE_PCT[1]:g} %: clean it, or put in another"
        )
        found.append(Finding("calibration.electrode_slope", text))
    if abs(offset_mv) > MOST_OFFSET_MV:
        text = (
            f"the electrode is off by {offset_mv:.1f} mV at pH 7; usable is up to "
            f"{MOST_OFFSET_MV:g} mV: renew its electrolyte, or put in another"
        )
        found.append(Finding("calibration.electrode_offset", text))
    return found
