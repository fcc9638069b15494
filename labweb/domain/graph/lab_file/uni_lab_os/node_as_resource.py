"""One node as a resource, and back, without a loss."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.graph.lab_file.uni_lab_os.format_words import (
    FOREIGN,
    FORMAT,
    KIND_BY_CATEGORY,
    KIND_BY_TYPE,
    is_pylabrobot,
)
from labweb.domain.graph.lab_file.uni_lab_os.node_liquid import NodeLiquid, read_holding
from labweb.domain.resources.pose import Pose
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import KINDS, is_vessel

_LONGEST_MM = 1_000_000


@dataclass(frozen=True)
class NodePlace:
    """Where a resource belongs in the lab, whatever its node says about itself."""

    id: UUID
    key: str
    parent_id: UUID | None
    parent_key: str | None


def kind_of(raw: Mapping[str, Any]) -> str:
    """Return the kind that the format's own words give a node, else `foreign`."""
    config = raw.get("config")
    if is_pylabrobot(config) and isinstance(config, Mapping):
        found = KIND_BY_CATEGORY.get(str(config["category"]))
        if found is not None:
            return found
    return KIND_BY_TYPE.get(str(raw.get("type")), FOREIGN)


def to_resource(
    place: NodePlace, raw: Mapping[str, Any], kind: str, config: Mapping[str, Any] | None = None
) -> tuple[Resource, NodeLiquid]:
    """Build the resource of a node, and what it says about liquid.

    Args:
        place: Identity and parent.
        raw: The node as the file has it.
        kind: One of `KINDS`.
        config: Further config for that kind, beyond a vessel's capacity.
    """
    holding = read_holding(place.key, raw) if is_vessel(kind) else NodeLiquid()
    known = dict(config or {})
    if holding.capacity_ul is not None:
        known.setdefault("capacity_ul", holding.capacity_ul)
    name = raw.get("name")
    placed = {"id": raw.get("id") == place.key, "name": isinstance(name, str) and bool(name)}
    if kind == FOREIGN:
        placed |= {field: isinstance(raw.get(field), Mapping) for field in ("config", "data")}
    here = sorted(field for field, is_placed in placed.items() if is_placed)
    rest = {field: deepcopy(value) for field, value in raw.items() if field not in here}
    resource = Resource(
        id=place.id,
        key=place.key,
        name=name if isinstance(name, str) and name else place.key,
        kind=kind,
        nature=KINDS[kind].nature,
        parent_id=place.parent_id,
        pose=_pose(raw),
        size_mm=_size(raw),
        config=deepcopy(dict(raw["config"])) if "config" in here else known,
        data=deepcopy(dict(raw["data"])) if "data" in here else {},
        extra={FORMAT: {"node": rest, "placed": here, "parent": place.parent_key}},
    )
    return resource, holding


def is_imported(resource: Resource) -> bool:
    """Tell whether a resource came from a node of this format."""
    carried = resource.extra.get(FORMAT)
    return isinstance(carried, Mapping) and "node" in carried


def is_synthetic(resource: Resource) -> bool:
    """Tell whether a resource is the root that the import added above several roots."""
    carried = resource.extra.get(FORMAT)
    return isinstance(carried, Mapping) and carried.get("synthetic") is True


def to_node(resource: Resource) -> dict[str, Any]:
    """Give back the node that `to_resource` was given."""
    carried = resource.extra[FORMAT]
    node: dict[str, Any] = deepcopy(dict(carried["node"]))
    values = {
        "id": resource.key,
        "name": resource.name,
        "config": resource.config,
        "data": resource.data,
    }
    for field in carried["placed"]:
        value = values[field]
        node[field] = deepcopy(dict(value)) if isinstance(value, Mapping) else value
    if "name" not in carried["placed"] and resource.name != resource.key:
        node["name"] = resource.name
    return node


def notes_of(resource: Resource, raw: Mapping[str, Any]) -> list[Finding]:
    """List what a reader should know about how a node was taken."""
    named = raw.get("class")
    if resource.kind != FOREIGN or not isinstance(named, str) or not named:
        return []
    text = f"{resource.key}: class {named!r} is mapped to no kind; kept whole, not schedulable"
    return [Finding("uni_lab_os.foreign", text, resource.key, {"class": named})]


def _pose(raw: Mapping[str, Any]) -> Pose | None:
    """Return the pose of a PyLabRobot resource; other positions are places on a drawing.

    Frame:
        PyLabRobot: mm, relative to the parent's front left bottom; rotation in degrees.
    """
    config, position = raw.get("config"), raw.get("position")
    if not is_pylabrobot(config) or not isinstance(config, Mapping):
        return None
    if not isinstance(position, Mapping):
        return None
    numbers = [position.get(axis) for axis in "xyz"]
    angles = [config["rotation"].get(axis, 0) for axis in "xyz"]
    if not all(_is_place(number) for number in (*numbers, *angles)):
        return None
    if angles[0] or angles[1]:
        return None
    half = math.radians(angles[2]) / 2
    x_mm, y_mm, z_mm = (float(number or 0) for number in numbers)
    return Pose(x_mm, y_mm, z_mm, (math.cos(half), 0.0, 0.0, math.sin(half)))


def _is_place(value: object) -> bool:
    return type(value) in (int, float) and abs(float(str(value))) <= _LONGEST_MM


def _size(raw: Mapping[str, Any]) -> tuple[float, float, float] | None:
    config = raw.get("config")
    if not is_pylabrobot(config) or not isinstance(config, Mapping):
        return None
    sizes = [_length(config.get(f"size_{axis}")) for axis in "xyz"]
    if not all(sizes):
        return None
    return (sizes[0], sizes[1], sizes[2])


def _length(value: object) -> float:
    """Return a length; zero when it is none, as for things that have no thickness."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return 0.0
    return float(value) if 0 < value <= _LONGEST_MM else 0.0
