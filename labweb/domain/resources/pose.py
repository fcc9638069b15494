"""Where a resource stands, or that nobody knows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from labweb.domain.errors import LabFileError

_UNIT_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class Pose:
    """Position and attitude relative to the parent.

    Frame:
        Parent frame: x right, y to the back, z up, mm. The quaternion (w, x, y, z) turns
        this resource's axes into the parent's. An unknown pose is None, never zero.
    """

    x_mm: float
    y_mm: float
    z_mm: float
    rotation_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    def to_json(self) -> dict[str, Any]:
        """Render as plain data."""
        return {
            "x_mm": self.x_mm,
            "y_mm": self.y_mm,
            "z_mm": self.z_mm,
            "rotation_wxyz": list(self.rotation_wxyz),
        }


def parse_pose(value: Mapping[str, Any] | None) -> Pose | None:
    """Read a pose; None means that nobody knows where the resource is.

    Raises:
        LabFileError: A number is missing, not finite, or the quaternion is no rotation.
    """
    if value is None:
        return None
    try:
        numbers = [float(value[key]) for key in ("x_mm", "y_mm", "z_mm")]
        w, x, y, z = (float(part) for part in value.get("rotation_wxyz", (1.0, 0.0, 0.0, 0.0)))
    except (KeyError, TypeError, ValueError) as error:
        raise LabFileError(f"pose {value!r} lacks a number", code="pose.invalid") from error
    if not all(math.isfinite(number) for number in (*numbers, w, x, y, z)):
        raise LabFileError(f"pose {value!r} is not finite", code="pose.invalid")
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if abs(norm - 1.0) > _UNIT_TOLERANCE:
        raise LabFileError(f"rotation_wxyz has length {norm:.4f}, not 1", code="pose.invalid")
    return Pose(numbers[0], numbers[1], numbers[2], (w, x, y, z))
