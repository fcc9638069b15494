"""Inside of a well: how much stands in it at a height, and how high an amount stands.

A cavity is a stack of sections from the bottom up. One cubic millimetre is one microlitre.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from labweb.domain.errors import InfeasibleError

_Length = Annotated[float, Meta(ge=0, le=10_000)]
_Height = Annotated[float, Meta(ge=0, le=10_000)]
_Count = Annotated[int, Meta(ge=1, le=10_000)]

MAX_SECTIONS = 1_000
"""Most sections of a cavity, and most points of a table."""

_JOINT_MM = 1e-6
_HALVINGS = 200


class _Section(
    msgspec.Struct, frozen=True, kw_only=True, tag_field="shape", forbid_unknown_fields=True
):
    """Base of all sections: heights count from the bottom of the cavity."""

    bottom_mm: _Height
    top_mm: _Height


class Spherical(_Section, frozen=True, kw_only=True, tag="spherical"):
    """A cap of a sphere, round side down; it is the lowest section or none."""

    radius_mm: _Length
    count: _Count = 1


class Conical(_Section, frozen=True, kw_only=True, tag="conical"):
    """A frustum between two circles."""

    bottom_diameter_mm: _Length
    top_diameter_mm: _Length
    count: _Count = 1


class Cuboidal(_Section, frozen=True, kw_only=True, tag="cuboidal"):
    """Between two rectangles whose sides grow evenly."""

    bottom_x_mm: _Length
    bottom_y_mm: _Length
    top_x_mm: _Length
    top_y_mm: _Length
    count: _Count = 1


class SquaredCone(_Section, frozen=True, kw_only=True, tag="squared_cone"):
    """What a cone cuts out of an upright box: a circle at one end, the rectangle at the other."""

    diameter_mm: _Length
    x_mm: _Length
    y_mm: _Length
    circle: Literal["bottom", "top"]
    count: _Count = 1


class RoundedCuboid(_Section, frozen=True, kw_only=True, tag="rounded_cuboid"):
    """The hull of a circle at one end and a rectangle at the other."""

    diameter_mm: _Length
    x_mm: _Length
    y_mm: _Length
    circle: Literal["bottom", "top"]
    count: _Count = 1


class Table(_Section, frozen=True, kw_only=True, tag="table"):
    """Measured volumes by height; between two points the volume grows evenly."""

    points: tuple[tuple[_Height, Annotated[float, Meta(ge=0, le=1e12)]], ...]
    """Height in mm and volume in µL, both rising; the first is zero and zero."""


Solid = Spherical | Conical | Cuboidal | SquaredCone | RoundedCuboid
Section = Solid | Table
Cavity = tuple[Section, ...]
"""Sections from the bottom up, without a gap."""


def check_cavity(sections: Sequence[Section]) -> list[str]:
    """List, in words, why sections are no cavity; an empty list means that they are."""
    if not 1 <= len(sections) <= MAX_SECTIONS:
        return [f"a cavity has 1 to {MAX_SECTIONS} sections, not {len(sections)}"]
    problems: list[str] = []
    end_mm = 0.0
    for section in sections:
        where = f"section {section.bottom_mm:g} to {section.top_mm:g} mm"
        if section.top_mm <= section.bottom_mm:
            problems.append(f"{where} has no height")
        if abs(section.bottom_mm - end_mm) > _JOINT_MM:
            problems.append(f"{where} does not start at {end_mm:g} mm, where the one below ends")
        problems += [f"{where}: {problem}" for problem in _check_section(section, len(sections))]
        end_mm = section.top_mm
    return problems


def _check_section(section: Section, sections_count: int) -> list[str]:
    if isinstance(section, Table):
        return _check_table(section, sections_count)
    return [problem for is_wrong, problem in _checks(section) if is_wrong]


def _checks(section: Solid) -> list[tuple[bool, str]]:
    match section:
        case Spherical():
            return [
                (section.bottom_mm > 0, "a spherical section can only be the lowest"),
                (section.top_mm > 2 * section.radius_mm, "it is higher than its sphere"),
            ]
        case Conical():
            both = section.bottom_diameter_mm + section.top_diameter_mm
            return [(both <= 0, "both its diameters are zero")]
        case Cuboidal():
            widest = max(section.bottom_x_mm, section.top_x_mm)
            deepest = max(section.bottom_y_mm, section.top_y_mm)
            return [(widest <= 0 or deepest <= 0, "it has no area")]
        case SquaredCone():
            diagonal = math.hypot(section.x_mm, section.y_mm)
            return [
                (min(section.x_mm, section.y_mm) <= 0, "its rectangle has no area"),
                (section.diameter_mm > diagonal, "its circle is larger than its rectangle"),
            ]
        case RoundedCuboid():
            return [(min(section.x_mm, section.y_mm) <= 0, "its rectangle has no area")]


def _check_table(table: Table, sections_count: int) -> list[str]:
    points = table.points
    pairs = list(itertools.pairwise(points))
    checks = [
        (sections_count > 1, "a table is the whole cavity"),
        (not 2 <= len(points) <= MAX_SECTIONS, f"a table has 2 to {MAX_SECTIONS} points"),
        (bool(points) and points[0] != (0.0, 0.0), "a table starts at zero and zero"),
        (any(a[0] >= b[0] or a[1] >= b[1] for a, b in pairs), "height and volume must both rise"),
        (bool(points) and points[-1][0] != table.top_mm, "a table ends at its top"),
    ]
    return [problem for is_wrong, problem in checks if is_wrong]


def depth_mm(cavity: Cavity) -> float:
    """Return the greatest height that the cavity knows."""
    return cavity[-1].top_mm


def capacity_ul(cavity: Cavity) -> float:
    """Return what the cavity holds up to its top, in microlitres."""
    return sum(_volume(section, section.top_mm - section.bottom_mm) for section in cavity)


def volume_ul(cavity: Cavity, height_mm: float) -> float:
    """Return how much liquid stands in a cavity when its level is at a height.

    Raises:
        InfeasibleError: The height is no number, below the bottom or above the top.
    """
    if not 0 <= height_mm <= depth_mm(cavity):
        raise InfeasibleError(
            f"the level {height_mm} mm is not within 0 to {depth_mm(cavity):g} mm",
            code="labware.level",
        )
    return sum(
        _volume(section, min(height_mm, section.top_mm) - section.bottom_mm)
        for section in cavity
        if height_mm > section.bottom_mm
    )


def level_mm(cavity: Cavity, amount_nl: int) -> float:
    """Return how high an amount stands in a cavity.

    Raises:
        InfeasibleError: The amount is negative or more than the cavity holds.

    Example:
        >>> tube = (Conical(bottom_mm=0, top_mm=10, bottom_diameter_mm=2, top_diameter_mm=2),)
        >>> round(level_mm(tube, 15_708), 4)
        5.0
    """
    left_ul = amount_nl / 1000
    if left_ul < 0 or left_ul > capacity_ul(cavity) * (1 + 1e-12):
        raise InfeasibleError(
            f"{amount_nl} nL do not stand in a well of {capacity_ul(cavity):.3f} µL",
            code="labware.level",
        )
    for section in cavity:
        height_mm = section.top_mm - section.bottom_mm
        within_ul = _volume(section, height_mm)
        if left_ul <= within_ul:
            return section.bottom_mm + _solve(partial(_volume, section), left_ul, height_mm)
        left_ul -= within_ul
    return depth_mm(cavity)


def _solve(volume: Callable[[float], float], wanted_ul: float, height_mm: float) -> float:
    """Return where a volume that only grows reaches the wanted one, by halving."""
    low, high = 0.0, height_mm
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if middle in (low, high):
            break
        if volume(middle) < wanted_ul:
            low = middle
        else:
            high = middle
    return high


def _volume(section: Section, level: float) -> float:
    """Return the volume of a section from its bottom up to a level above its bottom."""
    if isinstance(section, Table):
        return _interpolate(section.points, level)
    return _single(section, level, section.top_mm - section.bottom_mm) * section.count


def _single(section: Solid, level: float, height: float) -> float:
    """Return the volume up to a level of one of the cavities that stand side by side.

    Source:
        The shapes are those of Opentrons labware schema 3, `InnerWellGeometry`. Spherical
        cap and frustum of a cone: Bronstein, Taschenbuch der Mathematik, 3.1.4.
    """
    match section:
        case Spherical():
            return math.pi * level**2 * (3 * section.radius_mm - level) / 3
        case Conical():
            low = section.bottom_diameter_mm / 2
            high = low + (section.top_diameter_mm / 2 - low) * level / height
            return math.pi * level * (low**2 + low * high + high**2) / 3
        case Cuboidal():
            return _cuboidal(section, level, height)
        case SquaredCone() | RoundedCuboid():
            part = _squared_cone if isinstance(section, SquaredCone) else _rounded_cuboid
            if section.circle == "bottom":
                return part(section, level / height) * height
            return (part(section, 1.0) - part(section, 1 - level / height)) * height


def _cuboidal(section: Cuboidal, level: float, height: float) -> float:
    x, y = section.bottom_x_mm, section.bottom_y_mm
    x_slope = (section.top_x_mm - x) / height
    y_slope = (section.top_y_mm - y) / height
    return (
        x * y * level
        + (x * y_slope + y * x_slope) * level**2 / 2
        + (x_slope * y_slope * level**3 / 3)
    )


def _rounded_cuboid(section: SquaredCone | RoundedCuboid, t: float) -> float:
    """Integrate the area from the circle (0) to the share `t` of the way to the rectangle.

    The cross-section at `t` is the rectangle shrunk by `t`, widened all around by the radius
    shrunk by `1 - t`: area = t²xy + 2t(1 - t)(x + y)r + (1 - t)²πr².
    """
    x, y, r = section.x_mm, section.y_mm, section.diameter_mm / 2
    return (
        x * y * t**3 / 3
        + 2 * (x + y) * r * (t**2 / 2 - t**3 / 3)
        + math.pi * r**2 * (1 - (1 - t) ** 3) / 3
    )


def _squared_cone(section: SquaredCone | RoundedCuboid, t: float) -> float:
    """Integrate the area from the circle (0) to the share `t` of the way to the rectangle.

    The radius grows evenly from that of the circle to half the diagonal, and the box cuts
    off a segment on each side that the circle crosses.
    """
    start = section.diameter_mm / 2
    end = math.hypot(section.x_mm, section.y_mm) / 2
    if math.isclose(start, end, rel_tol=1e-12):
        return section.x_mm * section.y_mm * t
    r = start + (end - start) * t
    return (_clipped(section, r) - _clipped(section, start)) / (end - start)


def _clipped(section: SquaredCone | RoundedCuboid, r: float) -> float:
    """Integrate, from zero to `r`, the area of a circle of that radius within the box."""
    sides = (section.x_mm / 2, section.y_mm / 2)
    return math.pi * r**3 / 3 - 2 * sum(_segments(r, side) for side in sides)


def _segments(r: float, a: float) -> float:
    """Integrate the segment beyond distance `a`: r² acos(a/r) - a √(r² - a²), from a to `r`."""
    if r <= a:
        return 0.0
    s = math.sqrt(r**2 - a**2)
    return r**3 * math.acos(a / r) / 3 - 2 * a * r * s / 3 + a**3 * math.log((r + s) / a) / 3


def _interpolate(points: Sequence[tuple[float, float]], level: float) -> float:
    for (low, below), (high, above) in itertools.pairwise(points):
        if level <= high:
            return below + (above - below) * (level - low) / (high - low)
    return points[-1][1]
