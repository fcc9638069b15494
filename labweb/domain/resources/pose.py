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


Quaternion = tuple[float, float, float, float]
"""w, x, y, z; of length one."""


def rotate(
    rotation_wxyz: Quaternion, point: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Turn a point by a rotation.

    Example:
        >>> half = math.sqrt(0.5)
        >>> [round(part, 6) for part in rotate((half, 0.0, 0.0, half), (1.0, 0.0, 5.0))]
        [0.0, 1.0, 5.0]
    """
    w, x, y, z = rotation_wxyz
    a, b, c = point
    # t = 2 q × p, and p + w t + q × t.
    t = (2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a))
    return (
        a + w * t[0] + y * t[2] - z * t[1],
        b + w * t[1] + z * t[0] - x * t[2],
        c + w * t[2] + x * t[1] - y * t[0],
    )


def turn(first: Quaternion, then: Quaternion) -> Quaternion:
    """Return the rotation of a frame `then` that stands in a frame `first`."""
    a, b, c, d = first
    w, x, y, z = then
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def compose(parent: Pose, child: Pose) -> Pose:
    """Return the pose, in the parent's frame's own parent, of what stands in it."""
    x, y, z = rotate(parent.rotation_wxyz, (child.x_mm, child.y_mm, child.z_mm))
    return Pose(
        parent.x_mm + x,
        parent.y_mm + y,
        parent.z_mm + z,
        turn(parent.rotation_wxyz, child.rotation_wxyz),
    )


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
