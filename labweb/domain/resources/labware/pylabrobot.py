"""Read what PyLabRobot serialises: a deck, a carrier, a plate, with all that stands in it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from labweb.domain.errors import Finding
from labweb.domain.resources.labware.foreign_json import FARTHEST_MM, JsonReader, open_reader
from labweb.domain.resources.labware.labware_definition import ZERO, TipDefinition, Vector
from labweb.domain.resources.labware.labware_parts import LabwarePart
from labweb.domain.resources.labware.well_geometry import MAX_SECTIONS, Cavity, Table, check_cavity
from labweb.domain.resources.pose import Pose, Quaternion, turn

MAX_PARTS = 100_000

MAX_DEPTH = 32
"""Deepest nesting of parts."""

_KINDS: Mapping[str, str] = {
    "deck": "deck",
    "resource_holder": "slot",
    "plate_holder": "slot",
    "carrier": "carrier",
    "plate_carrier": "carrier",
    "tip_carrier": "carrier",
    "tube_carrier": "carrier",
    "trough_carrier": "carrier",
    "mfx_carrier": "carrier",
    "plate_adapter": "carrier",
    "plate": "plate",
    "well": "well",
    "tip_rack": "tip_rack",
    "tip_spot": "tip_spot",
    "tube_rack": "tube_rack",
    "tube": "tube",
    "trough": "trough",
    "lid": "lid",
    "trash": "waste",
}
"""Our kind by category; the class is not asked, for every robot has a deck class of its own."""

_VESSELS = frozenset({"well", "tube", "trough", "waste"})
_ONE_AXIS = 1e-9


@dataclass
class _Walk:
    """What is kept while the tree is read."""

    names: set[str] = field(default_factory=set)
    count: int = 0
    notes: list[Finding] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Frame:
    """Attitude of a parent: as turned, and as the sum of angles that PyLabRobot takes for it."""

    rotation: Quaternion = (1.0, 0.0, 0.0, 0.0)
    angles: Vector = ZERO


def is_pylabrobot(value: object) -> bool:
    """Tell whether decoded JSON is meant as such a resource."""
    return isinstance(value, Mapping) and {"type", "size_x", "children"} <= value.keys()


def parse_pylabrobot(value: object) -> tuple[LabwarePart, list[Finding]]:
    """Read one resource and all below it.

    Args:
        value: The decoded JSON of `Resource.serialize()`.

    Returns:
        The part, and notes on what was left out on purpose. Code that a file carries to
        compute volumes is never run.

    Raises:
        DefinitionError: `labware.invalid`; the findings name every field that is wrong.

    Frame:
        Each part is placed by its front left bottom corner in the frame of its parent and
        turned about that corner.

    Source:
        PyLabRobot 0.2.2, `resources/resource.py` and `resources/rotation.py`. The rotation of
        one part is z after y after x, in degrees.
    """
    walk = _Walk()
    reader = open_reader(value, "the resource")
    part = _read(reader, walk, _Frame(), 1)
    reader.done("the resource")
    return part, walk.notes


def _read(reader: JsonReader, walk: _Walk, above: _Frame, depth: int) -> LabwarePart:
    name = reader.text("name")
    if name and name in walk.names:
        reader.refuse("labware.duplicate", f"the name {name!r} stands twice", "name")
    walk.names.add(name)
    category = reader.text("category") if reader.has("category") else ""
    kind = _KINDS.get(category, "foreign")
    rotation, frame = _read_rotation(reader, above)
    return LabwarePart(
        name=name,
        label=reader.text("model") if reader.has("model") else name,
        kind=kind,
        type=reader.text("type"),
        size=Vector(*(reader.number(f"size_{axis}") for axis in "xyz")),
        pose=_read_pose(reader, rotation),
        capacity_nl=_read_capacity(reader) if kind in _VESSELS else None,
        is_round=reader.value.get("cross_section_type") == "circle",
        cavity=_read_cavity(reader, walk) if kind in _VESSELS else None,
        tip=_read_tip(reader) if kind == "tip_spot" else None,
        addresses=_read_addresses(reader),
        children=tuple(_read_children(reader, walk, frame, depth)),
    )


def _read_children(
    reader: JsonReader, walk: _Walk, frame: _Frame, depth: int
) -> Iterator[LabwarePart]:
    children = list(reader.objects("children", MAX_PARTS))
    walk.count += len(children)
    if children and depth >= MAX_DEPTH:
        reader.refuse("labware.depth", f"has parts nested deeper than {MAX_DEPTH}", "children")
    elif walk.count > MAX_PARTS:
        reader.refuse("labware.too_many", f"has more than {MAX_PARTS} parts", "children")
    else:
        for child in children:
            yield _read(child, walk, frame, depth + 1)


def _read_rotation(reader: JsonReader, above: _Frame) -> tuple[Quaternion, _Frame]:
    """Return the rotation against the parent, and the frame for what stands in it.

    PyLabRobot adds the angles of parent and child, which is the rotation they make together
    only when both turn about the same axis. Where the two differ, nobody knows which one the
    person meant.
    """
    given = reader.optional_object("rotation")
    angles = Vector(
        *(given.number(axis, -FARTHEST_MM) if given.has(axis) else 0.0 for axis in "xyz")
    )
    own = _quaternion(angles)
    added = above.angles.plus(angles)
    together = turn(above.rotation, own)
    same = abs(sum(a * b for a, b in zip(together, _quaternion(added), strict=True)))
    if same < 1 - _ONE_AXIS:
        reader.refuse(
            "labware.rotation",
            "is turned about another axis than what it stands in, and the format does not "
            "say which turn comes first",
            "rotation",
        )
    return own, _Frame(together, added)


def _quaternion(angles: Vector) -> Quaternion:
    x, y, z = (math.radians(angle % 360) / 2 for angle in angles)
    about_x = (math.cos(x), math.sin(x), 0.0, 0.0)
    about_y = (math.cos(y), 0.0, math.sin(y), 0.0)
    about_z = (math.cos(z), 0.0, 0.0, math.sin(z))
    return turn(turn(about_z, about_y), about_x)


def _read_pose(reader: JsonReader, rotation: Quaternion) -> Pose | None:
    if not reader.has("location"):
        return None
    return Pose(*reader.vector("location"), rotation)


def _read_capacity(reader: JsonReader) -> int | None:
    """Return the capacity; none where the file says infinite, which no vessel is."""
    if not reader.has("max_volume") or reader.value["max_volume"] == "Infinity":
        return None
    return reader.capacity_nl("max_volume")


def _read_cavity(reader: JsonReader, walk: _Walk) -> Cavity | None:
    for key in ("compute_volume_from_height", "compute_height_from_volume"):
        if reader.has(key):
            message = f"{reader.path}.{key}: is code of others and was not run"
            walk.notes.append(Finding("labware.code_left_out", message, reader.path))
    if not reader.has("height_volume_data"):
        return None
    data = reader.optional_object("height_volume_data")
    if len(data.value) > MAX_SECTIONS:
        data.refuse("labware.too_many", f"has more than {MAX_SECTIONS} points")
        return None
    before = len(reader.findings)
    points = sorted((_height(data, key), data.number(key, high=1e12)) for key in data.value)
    if points and points[0][0] > 0:
        points.insert(0, (0.0, 0.0))
    top = points[-1][0] if points else 0.0
    cavity = (Table(bottom_mm=0.0, top_mm=top, points=tuple(points)),)
    if len(reader.findings) == before:
        for problem in check_cavity(cavity):
            data.refuse("labware.geometry", problem)
    return cavity


def _height(data: JsonReader, key: str) -> float:
    try:
        height = float(key)
    except (TypeError, ValueError):
        height = math.nan
    if not 0 <= height <= FARTHEST_MM:
        data.refuse("labware.number", f"{str(key)[:40]!r} is no height")
        return 0.0
    return height


def _read_tip(reader: JsonReader) -> TipDefinition | None:
    if not reader.has("prototype_tip"):
        return None
    tip = reader.optional_object("prototype_tip")
    return TipDefinition(
        length_mm=tip.number("total_tip_length"),
        overlap_mm=tip.optional_number("fitting_depth"),
        capacity_nl=tip.capacity_nl("maximal_volume"),
    )


def _read_addresses(reader: JsonReader) -> dict[str, str]:
    """Return address by the name of the child; the format writes it the other way round."""
    if not reader.has("ordering"):
        return {}
    ordering = reader.optional_object("ordering")
    children = reader.value.get("children")
    listed = children if isinstance(children, list) else []
    names = {child.get("name") for child in listed if isinstance(child, Mapping)}
    found: dict[str, str] = {}
    for address in ordering.value:
        child = ordering.text(address)
        if not reader.is_name(address) or child not in names or child in found:
            reader.refuse(
                "labware.ordering", f"{str(address)[:40]!r} names no child of its own", "ordering"
            )
        found[child] = address
    return found
