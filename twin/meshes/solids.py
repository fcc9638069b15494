"""Vertices and faces of the plain solids everything is built from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from numpy.typing import NDArray

from twin.profile import Point

_CREASE = float(np.cos(np.radians(35.0)))
"""Faces that meet at a wider angle keep an edge between them."""

SECTIONS = 40
"""Corners of a circle; the same everywhere, so that a level can change without a new mesh."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface.

    Frame:
        That of the resource: origin at its front left bottom corner, mm.
    """

    vertices_mm: NDArray[np.float32]
    """(n, 3)."""

    faces: NDArray[np.uint32]
    """(m, 3), counter-clockwise from outside."""

    @cached_property
    def for_display(self) -> Mesh:
        """The same surface with its sharp edges cut apart, so that light breaks on them."""
        return _creased(self)

    def to_trimesh(self) -> trimesh.Trimesh:
        """Give it to trimesh for volume and bounds."""
        return trimesh.Trimesh(self.vertices_mm, self.faces, process=False)


Offset = tuple[float, float, float]


def box(low: Offset, high: Offset) -> trimesh.Trimesh:
    """Make a box between two corners."""
    extents = np.subtract(high, low)
    found: trimesh.Trimesh = trimesh.creation.box(extents=extents)
    found.apply_translation(np.add(low, extents / 2.0))
    return found


def disc(radius: float, low: float, high: float, at: tuple[float, float]) -> trimesh.Trimesh:
    """Make an upright cylinder around `at`."""
    found = _cylinder(radius, high - low)
    found.apply_translation((at[0], at[1], (low + high) / 2.0))
    return found


def rod_towards_front(
    radius: float, at: tuple[float, float], front: float, back: float
) -> trimesh.Trimesh:
    """Make a cylinder along y: a knob, the face of a valve."""
    found = _cylinder(radius, back - front)
    found.apply_transform(_turn(np.pi / 2.0, (1.0, 0.0, 0.0)))
    found.apply_translation((at[0], (front + back) / 2.0, at[1]))
    return found


def turned(points: Sequence[Point], at: tuple[float, float]) -> trimesh.Trimesh:
    """Turn an outline of (radius, height) around the vertical through `at`, closed at its ends."""
    outline = [(0.0, points[0][1]), *points, (0.0, points[-1][1])]
    found: trimesh.Trimesh = trimesh.creation.revolve(
        np.asarray(outline, dtype=float), sections=SECTIONS
    )
    found.apply_translation((at[0], at[1], 0.0))
    return found


def ring(
    radius: float, thickness: float, height: float, at: tuple[float, float], dashes: int = 0
) -> trimesh.Trimesh:
    """Make a flat-lying torus around `at`; with dashes it is cut into that many pieces."""
    if dashes:
        found = _joined([_arc(radius, thickness, number, dashes) for number in range(dashes)])
    else:
        found = trimesh.creation.torus(
            major_radius=radius, minor_radius=thickness, major_sections=64, minor_sections=10
        )
    found.apply_translation((at[0], at[1], height))
    return found


def _arc(radius: float, thickness: float, number: int, dashes: int) -> trimesh.Trimesh:
    """Make one dash: a round bar bent over 60 % of its share of the circle, closed at its ends."""
    share = 2.0 * np.pi / dashes
    bends, sides = 8, 10
    along = share * (number + np.linspace(0.0, 0.6, bends + 1))[:, None]
    around = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)[None, :]
    out = radius + thickness * np.cos(around)
    height = np.broadcast_to(thickness * np.sin(around), (bends + 1, sides))
    grid = np.stack((out * np.cos(along), out * np.sin(along), height), axis=-1).reshape(-1, 3)
    faces = []
    for bend in range(bends):
        for side in range(sides):
            low, high = bend * sides + side, bend * sides + (side + 1) % sides
            faces += [(low, low + sides, high), (high, low + sides, high + sides)]
    last = bends * sides
    for side in range(1, sides - 1):
        faces += [(0, side, side + 1), (last, last + side + 1, last + side)]
    return trimesh.Trimesh(grid, faces, process=False)


def _cylinder(radius: float, height: float) -> trimesh.Trimesh:
    found: trimesh.Trimesh = trimesh.creation.cylinder(
        radius=radius, height=height, sections=SECTIONS
    )
    return found


def _turn(angle_rad: float, axis: Offset) -> NDArray[np.float64]:
    turn: NDArray[np.float64] = trimesh.transformations.rotation_matrix(angle_rad, axis)  # type: ignore[no-untyped-call]
    return turn


def merged(*solids: trimesh.Trimesh) -> Mesh:
    """Join solids into one surface."""
    return _mesh(_joined(list(solids)))


def _joined(solids: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    whole = trimesh.util.concatenate(solids) if len(solids) > 1 else solids[0]
    assert isinstance(whole, trimesh.Trimesh)  # noqa: S101 - of meshes it makes a mesh
    return whole


def _mesh(solid: trimesh.Trimesh) -> Mesh:
    return Mesh(
        np.ascontiguousarray(solid.vertices, dtype=np.float32),
        np.ascontiguousarray(solid.faces, dtype=np.uint32),
    )


def _creased(mesh: Mesh) -> Mesh:
    """Give each corner one vertex per group of faces that pass smoothly into each other."""
    corners = mesh.vertices_mm[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    groups: dict[int, list[tuple[NDArray[np.float32], int]]] = {}
    vertices: list[NDArray[np.float32]] = []
    faces = np.empty_like(mesh.faces)
    for number, (face, normal) in enumerate(zip(mesh.faces, normals, strict=True)):
        for place, corner in enumerate(face.tolist()):
            known = groups.setdefault(corner, [])
            index = next((i for other, i in known if float(other @ normal) > _CREASE), None)
            if index is None:
                index = len(vertices)
                vertices.append(mesh.vertices_mm[corner])
                known.append((normal, index))
            faces[number, place] = index
    return Mesh(np.asarray(vertices, dtype=np.float32), faces)
