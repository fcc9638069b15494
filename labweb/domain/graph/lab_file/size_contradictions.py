"""Resources whose sizes, poses and volumes contradict each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.resources.labware.definition_check import TOLERANCE_MM, TOLERANCE_RATIO
from labweb.domain.resources.pose import rotate
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.domain.resources.resource_tree import Tree

_FRAMES = frozenset({"deck", "plate", "tip_rack", "tube_rack", "reservoir", "carrier"})
_FIXED = frozenset({"slot", "well", "tip_spot", "trough", "tube"})
"""What lies within the outline of that which it is a part of."""


def check_sizes(tree: Tree) -> Iterator[Finding]:
    """Yield, by node and field, what lies outside of its parent or holds more than its own box.

    Where a size or a pose is unknown, nothing is said of it.
    """
    for resource in tree.resources:
        parent = tree.by_id.get(resource.parent_id) if resource.parent_id else None
        if parent is not None:
            yield from _check_outline(resource, parent)
        yield from _check_volume(resource)


def _check_outline(resource: Resource, parent: Resource) -> Iterator[Finding]:
    if parent.kind not in _FRAMES or resource.kind not in _FIXED:
        return
    pose, size, outer = resource.pose, resource.size_mm, parent.size_mm
    if pose is None or outer is None:
        return
    far = (0.0, 0.0, 0.0) if size is None else rotate(pose.rotation_wxyz, size)
    corner = (pose.x_mm, pose.y_mm)
    for axis, start, length, most in zip("xy", corner, far[:2], outer[:2], strict=True):
        low, high = sorted((start, start + length))
        if low < -TOLERANCE_MM or high > most + TOLERANCE_MM:
            text = (
                f"{axis}_mm puts it at {low:g} to {high:g} mm, outside of {parent.name}, which is "
                f"{most:g} mm wide there"
            )
            yield _finding("pose.outside", resource, "pose", text)


def _check_volume(resource: Resource) -> Iterator[Finding]:
    capacity_ul = _number(resource.config, "capacity_ul")
    if resource.size_mm is None or capacity_ul is None or not is_vessel(resource.kind):
        return
    x, y, z = resource.size_mm
    box_ul = x * y * z
    if capacity_ul > box_ul * (1 + TOLERANCE_RATIO):
        text = f"capacity_ul is {capacity_ul:g}, and a box of {x:g} × {y:g} × {z:g} mm holds "
        yield _finding("lab_file.volume", resource, "config", f"{text}{box_ul:.6g} µL")


def _number(config: Mapping[str, Any], name: str) -> float | None:
    value = config.get(name)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number and value is not None else None


def _finding(code: str, resource: Resource, field: str, text: str) -> Finding:
    message = f"resources[{resource.key!r}]: {field}: {text}"
    return Finding(code, message, resource.key, {"field": field})
