"""Vessels as bodies of revolution: what they look like, and how high liquid stands in them."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

Point = tuple[float, float]
"""Radius and height, mm."""

_ARC_STEPS = 20


@dataclass(frozen=True)
class Profile:
    """Inner wall of a vessel, from its bottom up, as a chain of frustums.

    Heights rise strictly. Between two points the radius is linear, so that a cylinder and
    a cone are exact, and a sphere is as good as its number of points.
    """

    points_mm: tuple[Point, ...]

    @property
    def height_mm(self) -> float:
        """Height of the highest point above the lowest."""
        return self.points_mm[-1][1] - self.points_mm[0][1]

    @cached_property
    def _sums_mm3(self) -> tuple[float, ...]:
        sums = [0.0]
        for (low_r, low_z), (high_r, high_z) in self._frustums():
            sums.append(sums[-1] + _frustum_mm3(low_r, high_r, high_z - low_z))
        return tuple(sums)

    def _frustums(self) -> list[tuple[Point, Point]]:
        return list(zip(self.points_mm, self.points_mm[1:], strict=False))

    @property
    def volume_mm3(self) -> float:
        """Volume up to the highest point; 1 mm³ is 1 µL."""
        return self._sums_mm3[-1]

    def level_mm(self, fraction: float) -> float:
        """Find how high liquid stands when it fills this part of the volume.

        Args:
            fraction: Share of the whole volume; what is outside 0 ≤ x ≤ 1 is cut off.

        Returns:
            Height above the lowest point; strictly rising with `fraction`.

        Source:
            Volume of a frustum, π h (R² + R r + r²) / 3, solved for the radius at the
            surface: along a frustum the cubes of the radii grow in proportion to volume.

        Example:
            >>> Profile(((10.0, 0.0), (10.0, 40.0))).level_mm(0.25)
            10.0
        """
        wanted = min(max(fraction, 0.0), 1.0) * self.volume_mm3
        index = min(bisect_right(self._sums_mm3, wanted), len(self._sums_mm3) - 1) - 1
        (low_r, low_z), (high_r, high_z) = self._frustums()[index]
        whole = self._sums_mm3[index + 1] - self._sums_mm3[index]
        part = (wanted - self._sums_mm3[index]) / whole
        rise = (high_z - low_z) * _share_of_height(low_r, high_r, part)
        return low_z - self.points_mm[0][1] + rise

    def below(self, height_mm: float) -> tuple[Point, ...]:
        """Cut the profile off at a height above its lowest point."""
        bottom = self.points_mm[0][1]
        cut = bottom + min(max(height_mm, 0.0), self.height_mm)
        kept: list[Point] = []
        for (low_r, low_z), (high_r, high_z) in self._frustums():
            kept.append((low_r, low_z))
            if cut <= high_z:
                share = (cut - low_z) / (high_z - low_z)
                kept.append((low_r + (high_r - low_r) * share, cut))
                break
        return tuple(kept)


def _frustum_mm3(low_r: float, high_r: float, height: float) -> float:
    return math.pi * height * (low_r * low_r + low_r * high_r + high_r * high_r) / 3.0


def _share_of_height(low_r: float, high_r: float, part: float) -> float:
    """Return which share of a frustum's height holds this part of its volume."""
    if math.isclose(low_r, high_r, rel_tol=1e-9):
        return part
    cube = low_r**3 + part * (high_r**3 - low_r**3)
    return (math.cbrt(cube) - low_r) / (high_r - low_r)


def cylinder(radius: float, low: float, high: float) -> Profile:
    """Make a straight wall."""
    return Profile(((radius, low), (radius, high)))


def cone(low_radius: float, high_radius: float, low: float, high: float) -> Profile:
    """Make a wall that narrows or widens evenly."""
    return Profile(((low_radius, low), (high_radius, high)))


def sphere(radius: float, low: float, share: float = 0.94) -> Profile:
    """Make the wall of a round-bottomed flask, up to this share of the sphere's height."""
    last = math.acos(1.0 - 2.0 * share)
    points = [
        (radius * math.sin(angle), low + radius * (1.0 - math.cos(angle)))
        for angle in (last * step / _ARC_STEPS for step in range(_ARC_STEPS + 1))
    ]
    return Profile(tuple(points))
