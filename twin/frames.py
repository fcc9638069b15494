"""Poses along the tree: where a resource stands in the room."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from twin.state import TwinResource

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""(w, x, y, z), length 1."""

STILL: Quaternion = (1.0, 0.0, 0.0, 0.0)

ABSTRACT = frozenset({"lab", "site", "room", "archive"})
"""Places without a body. One without a pose is the frame it stands in."""


@dataclass(frozen=True, slots=True)
class Frame:
    """Where something stands.

    Frame:
        The room: x right, y to the back, z up, mm.
    """

    position_mm: Vector = (0.0, 0.0, 0.0)
    wxyz: Quaternion = STILL

    def then(self, position_mm: Vector, wxyz: Quaternion) -> Frame:
        """Return where something stands whose pose is given in this frame."""
        return Frame(self.to_room(position_mm), multiply(self.wxyz, wxyz))

    def to_room(self, point_mm: Vector) -> Vector:
        """Return a point of this frame in the room."""
        x, y, z = rotate(self.wxyz, point_mm)
        return x + self.position_mm[0], y + self.position_mm[1], z + self.position_mm[2]


def multiply(first: Quaternion, second: Quaternion) -> Quaternion:
    """Return the rotation that turns by `second` and then by `first`.

    Source:
        Hamilton product.
    """
    aw, ax, ay, az = first
    bw, bx, by, bz = second
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def rotate(wxyz: Quaternion, point: Vector) -> Vector:
    """Turn a point."""
    w, x, y, z = wxyz
    _, px, py, pz = multiply(multiply(wxyz, (0.0, *point)), (w, -x, -y, -z))
    return px, py, pz


def frames_of(
    resources: Mapping[str, TwinResource],
) -> tuple[dict[str, Frame], dict[str, TwinResource]]:
    """Place every resource whose way to the room is known.

    Returns:
        Frames by id, and what has to be parked: resources with a body and no pose. What
        stands on a parked one is in neither; `ride` places it once the parking has a place.
    """
    placed: dict[str, Frame] = {}
    parked: dict[str, TwinResource] = {}
    for row in _parents_first(resources):
        above = Frame() if row.parent_id is None else placed.get(row.parent_id)
        if row.pose is None:
            if row.kind in ABSTRACT and above is not None:
                placed[row.id] = above
            elif row.kind not in ABSTRACT:
                parked[row.id] = row
        elif above is not None:
            pose = row.pose
            placed[row.id] = above.then((pose.x_mm, pose.y_mm, pose.z_mm), pose.rotation_wxyz)
    return placed, parked


def ride(resources: Mapping[str, TwinResource], placed: dict[str, Frame]) -> None:
    """Place what stands, with a known pose, on something that was parked."""
    for row in _parents_first(resources):
        above = placed.get(row.parent_id or "")
        if row.id not in placed and row.pose is not None and above is not None:
            pose = row.pose
            placed[row.id] = above.then((pose.x_mm, pose.y_mm, pose.z_mm), pose.rotation_wxyz)


def _parents_first(resources: Mapping[str, TwinResource]) -> list[TwinResource]:
    """Order the tree from the root down; a parent that is missing counts as none."""
    depths: dict[str, int] = {}

    def depth(row: TwinResource) -> int:
        chain: list[TwinResource] = []
        while row.id not in depths:
            chain.append(row)
            parent = resources.get(row.parent_id or "")
            if parent is None or len(chain) > len(resources):
                break
            row = parent
        base = depths.get(row.id, -1)
        for node in reversed(chain):
            base += 1
            depths[node.id] = base
        return base

    return sorted(resources.values(), key=depth)
