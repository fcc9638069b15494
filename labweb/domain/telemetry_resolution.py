"""How finely telemetry is kept and drawn: levels, and which of them answers a question."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

RAW = 0
"""Stands for the samples themselves where a level is asked for."""

LEVELS_S = (1, 60, 3600)
"""Widths of the buckets that samples are rolled up into, finest first."""

NAMES = {"raw": RAW, "1s": 1, "1min": 60, "1h": 3600}
"""What a person calls the levels."""

MOST_POINTS = 2000
"""No series of one answer has more."""

SLACK_S = 2 * 3600.0
"""What is trimmed is older than its age by so much more.

A bucket is computed anew from the level below when a sample comes late, so the whole of the
coarsest bucket that the oldest sample still taken lies in must be there.
"""


@dataclass(frozen=True, slots=True)
class Resolution:
    """Buckets to read, and how wide those are that are drawn."""

    level_s: int
    """Width of the buckets that are read."""

    step_s: int
    """Width of the buckets that are told: a multiple of `level_s`."""


def check_ages(kept_s: Mapping[int, float]) -> list[str]:
    """List what is wrong with the ages to which levels are kept; empty: nothing.

    Args:
        kept_s: Age in seconds by level, `RAW` included.
    """
    order = (RAW, *LEVELS_S)
    wrong = [f"the age of level {level} is not told" for level in order if level not in kept_s]
    if wrong:
        return wrong
    if not all(math.isfinite(kept_s[level]) and kept_s[level] >= SLACK_S for level in order):
        wrong.append(f"each age must be a number of at least {SLACK_S:.0f} s")
    wrong += [
        f"level {coarse} must be kept at least as long as level {fine}"
        for fine, coarse in pairwise(order)
        if kept_s[coarse] < kept_s[fine]
    ]
    return wrong


def choose_resolution(
    since_s: float, until_s: float, most_points: int, *, now_s: float, kept_s: Mapping[int, float]
) -> Resolution:
    """Choose the coarsest buckets that still give every point of a plot one of its own.

    A level that is no longer kept for the beginning of the range is passed over: what is told
    is then coarser, and never a plot whose beginning is missing.

    Args:
        since_s: Begin of the range, seconds since the Unix epoch.
        until_s: End of the range, above `since_s`.
        most_points: `1 ≤ most_points ≤ MOST_POINTS`.
        now_s: The time, for the ages.
        kept_s: Age in seconds to which each level is kept.

    Returns:
        Level and step, so that the range has at most `most_points + 1` buckets.

    Raises:
        ValueError: The range is empty, or `most_points` is out of its range.

    Example:
        >>> kept = {1: 7 * 86400.0, 60: 90 * 86400.0, 3600: 5 * 365 * 86400.0}
        >>> choose_resolution(0, 3600, 1000, now_s=3600, kept_s=kept)
        Resolution(level_s=1, step_s=4)
        >>> choose_resolution(0, 7 * 86400, 1000, now_s=7 * 86400, kept_s=kept)
        Resolution(level_s=60, step_s=660)
        >>> choose_resolution(0, 60, 1000, now_s=30 * 86400, kept_s=kept)
        Resolution(level_s=60, step_s=60)
    """
    if not since_s < until_s:
        raise ValueError(f"the range {since_s} to {until_s} is empty")
    if not 1 <= most_points <= MOST_POINTS:
        raise ValueError(f"{most_points} points are not 1 to {MOST_POINTS}")
    ideal_s = (until_s - since_s) / most_points
    kept = [level for level in LEVELS_S if since_s >= now_s - kept_s[level]] or [LEVELS_S[-1]]
    level_s = max((level for level in kept if level <= ideal_s), default=kept[0])
    return Resolution(level_s, level_s * max(1, math.ceil(ideal_s / level_s)))
