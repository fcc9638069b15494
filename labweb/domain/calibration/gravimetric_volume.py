"""A pump against the mass of water: what is weighed, and what becomes of it.

Source:
    ISO 8655-6:2022, gravimetric reference method: 10, 50 and 100 % of the nominal volume, water
    weighed in air, volume by the Z factor, evaporation watched.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from statistics import fmean

import msgspec

from labweb.domain.calibration.line_fit import Point
from labweb.domain.calibration.water_density import z_factor_ul_mg
from labweb.domain.errors import Finding

LEVELS_RATIO = (0.1, 0.5, 1.0)
"""Shares of the full stroke that are weighed."""

LEAST_REPEATS, MOST_REPEATS = 3, 10
Z_RATIO = 1e-4
"""Standard uncertainty of Z, as a share: 0.5 K of the water, 10 hPa of the air."""

WATER_C = (15.0, 30.0)
"""Water and air of a weighing, as ISO 8655-6 wants them."""


class Surroundings(msgspec.Struct, frozen=True, kw_only=True):
    """Water and air while it was weighed, as a person read them."""

    water_c: float
    pressure_kpa: float
    humidity_ratio: float = 0.5


class Weighing(msgspec.Struct, frozen=True, kw_only=True):
    """One volume that was pumped onto a balance."""

    asked_ul: float
    """Volume that the workflow asked for: the level."""

    indicated_ul: float
    """Volume that the pump was given, as sent."""

    before_mg: float
    after_mg: float
    before_s: float
    after_s: float
    """When it was weighed, in seconds from the first weighing."""


def check_surroundings(around: Surroundings) -> list[Finding]:
    """List what is wrong with water and air; empty means go."""
    found = []
    if not WATER_C[0] <= around.water_c <= WATER_C[1]:
        text = f"the water has {around.water_c:g} °C; weigh at {WATER_C[0]:g} to {WATER_C[1]:g} °C"
        found.append(Finding("calibration.not_water", text))
    if not 60 <= around.pressure_kpa <= 110 or not 0 <= around.humidity_ratio <= 1:
        text = (
            f"air of {around.pressure_kpa:g} kPa and {around.humidity_ratio:.0%} humidity is found "
            "in no laboratory"
        )
        found.append(Finding("calibration.not_air", text))
    return found


def points_of(
    weighings: Sequence[Weighing], around: Surroundings, balance_expanded_mg: float
) -> list[Point]:
    """Turn masses into volumes.

    Args:
        weighings: In the order in which they were made.
        around: Water and air.
        balance_expanded_mg: Expanded uncertainty (k = 2) of one weighing, by the certificate.
    """
    z = z_factor_ul_mg(around.water_c, around.pressure_kpa, around.humidity_ratio)
    points = []
    for one in weighings:
        reference = (one.after_mg - one.before_mg) * z
        balance = math.sqrt(2) * balance_expanded_mg / 2 * z
        points.append(
            Point(
                level=one.asked_ul,
                indicated=one.indicated_ul,
                reference=reference,
                standard=math.hypot(balance, Z_RATIO * reference),
                at_s=one.before_s,
            )
        )
    return points


def check_evaporation(weighings: Sequence[Weighing], tolerance: float) -> list[Finding]:
    """Note when the balance moves between weighings: water evaporates, or the pan drifts.

    Between the end of one weighing and the beginning of the next nothing is pumped: what the
    balance tells then is loss. Over the time of one weighing it may be a third of the tolerance.
    """
    rates = [
        (after.before_mg - before.after_mg) / (after.before_s - before.after_s)
        for before, after in pairwise(weighings)
        if after.before_s > before.after_s
    ]
    if not rates:
        return []
    smallest = min(weighings, key=lambda one: one.asked_ul)
    lost_mg = fmean(rates) * (smallest.after_s - smallest.before_s)
    mass_mg = abs(smallest.after_mg - smallest.before_mg)
    if abs(lost_mg) <= tolerance / 3 * mass_mg:
        return []
    text = (
        f"while nothing was pumped the balance moved by {lost_mg:.3g} mg in the time of one "
        f"weighing of {mass_mg:.4g} mg: water evaporates or the balance drifts; cover the vessel"
    )
    return [Finding("calibration.evaporation", text)]
