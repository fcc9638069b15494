"""A straight line through measured points, with what it does not say."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from labweb.domain.errors import StateError


class Point(msgspec.Struct, frozen=True, kw_only=True):
    """One comparison of a device with a reference."""

    level: float
    """What was asked of the device, or what the standard is called: points of one level are
    repeats."""

    indicated: float
    """What the device made of it, in its own numbers: as sent, or as read."""

    reference: float
    """The true value by the reference, in the quantity's unit."""

    standard: float
    """Standard uncertainty of the reference value."""

    at_s: float = 0.0
    """When, in seconds from the first."""


class FittedLine(msgspec.Struct, frozen=True, kw_only=True):
    """`reference = offset + gain × indicated`, by least squares."""

    gain: float
    offset: float
    gain_variance: float
    offset_variance: float
    covariance: float
    """Of gain and offset; all three scaled by the scatter about the line."""

    scatter: float
    """Standard deviation of the points about the line."""

    freedom: int
    """Degrees of freedom."""

    def at(self, indicated: float) -> float:
        """Return the true value that the line gives."""
        return self.offset + self.gain * indicated

    def standard_at(self, indicated: float) -> float:
        """Return the standard uncertainty of the line itself there."""
        variance = (
            self.offset_variance
            + indicated**2 * self.gain_variance
            + 2 * indicated * self.covariance
        )
        return math.sqrt(max(0.0, variance))


def fit_gain(points: Sequence[Point]) -> FittedLine:
    """Fit a line through zero; every point weighs by its share, as a pump's error is one.

    Raises:
        StateError: Fewer than two points, or one at or below zero.

    Source:
        Weighted least squares with the weights 1/x²: the mean of the ratios.

    Example:
        >>> made = [(100.0, 97.0), (500.0, 485.0), (1000.0, 970.0)]
        >>> points = [Point(level=x, indicated=x, reference=y, standard=0.1) for x, y in made]
        >>> round(fit_gain(points).gain, 6)
        0.97
    """
    if len(points) < 2 or any(point.indicated <= 0 for point in points):
        raise StateError("a gain needs two points above zero", code="calibration.too_few_points")
    ratios = [point.reference / point.indicated for point in points]
    gain = math.fsum(ratios) / len(ratios)
    freedom = len(ratios) - 1
    spread = math.sqrt(math.fsum((ratio - gain) ** 2 for ratio in ratios) / freedom)
    return FittedLine(
        gain=gain,
        offset=0.0,
        gain_variance=spread**2 / len(ratios),
        offset_variance=0.0,
        covariance=0.0,
        scatter=spread,
        freedom=freedom,
    )


def fit_line(points: Sequence[Point]) -> FittedLine:
    """Fit gain and offset, every point with the same weight.

    Raises:
        StateError: Fewer than three points, or all at one indicated value.

    Source:
        Ordinary least squares; ISO/TS 28037:2010, 6, with equal weights.
    """
    count = len(points)
    middle = math.fsum(point.indicated for point in points) / max(count, 1)
    width = math.fsum((point.indicated - middle) ** 2 for point in points)
    if count < 3 or not width:
        raise StateError(
            "gain and offset need three points, not all at one value",
            code="calibration.too_few_points",
        )
    height = math.fsum(point.reference for point in points) / count
    gain = math.fsum((p.indicated - middle) * (p.reference - height) for p in points) / width
    offset = height - gain * middle
    freedom = count - 2
    rest = math.fsum((p.reference - offset - gain * p.indicated) ** 2 for p in points)
    variance = rest / freedom
    return FittedLine(
        gain=gain,
        offset=offset,
        gain_variance=variance / width,
        offset_variance=variance * (1 / count + middle**2 / width),
        covariance=-variance * middle / width,
        scatter=math.sqrt(variance),
        freedom=freedom,
    )
