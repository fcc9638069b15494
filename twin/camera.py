"""Where to look from, so that the whole lab fills the picture and nothing is cut off."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from twin.frames import Vector

FOV_RAD = math.radians(30.0)
"""Vertical. A narrow view keeps upright things upright, like a drawing."""

_DIRECTIONS: Mapping[str, Vector] = {
    "overview": (0.22, -1.0, 0.80),
    "front": (0.0, -1.0, 0.18),
    "top": (0.0, -0.02, 1.0),
}
VIEWS = tuple(_DIRECTIONS)
_MARGIN = 1.06


@dataclass(frozen=True)
class View:
    """A camera.

    Frame:
        The room, mm; z is up.
    """

    position_mm: Vector
    look_at_mm: Vector


def view(name: str, low_mm: Vector, high_mm: Vector, aspect: float) -> View:
    """Stand where a box just fills the picture.

    Args:
        name: One of `VIEWS`; it fixes the direction from the box to the camera.
        low_mm: Lowest corner of the box.
        high_mm: Highest corner.
        aspect: Width of the picture by its height.
    """
    low, high = np.asarray(low_mm, dtype=float), np.asarray(high_mm, dtype=float)
    centre = (low + high) / 2.0
    back = np.asarray(_DIRECTIONS[name], dtype=float)
    back /= np.linalg.norm(back)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    tall = math.tan(FOV_RAD / 2.0)
    wide = tall * max(aspect, 0.2)
    corners = [np.asarray(c) - centre for c in product(*zip(low, high, strict=True))]
    # Seen from `distance` away, a corner is inside when its offset is at most depth × tan.
    distance = max(
        float(corner @ back + max(abs(corner @ right) / wide, abs(corner @ up) / tall) * _MARGIN)
        for corner in corners
    )
    x, y, z = (float(value) for value in centre + back * max(distance, 100.0))
    cx, cy, cz = (float(value) for value in centre)
    return View((x, y, z), (cx, cy, cz))
