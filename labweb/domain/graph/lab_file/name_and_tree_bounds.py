"""What no lab has: names that cannot be read, places out of sight, trees without end."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.resources.resource import Resource

FARTHEST_MM = 1e6
"""Largest distance of a resource from its parent, along each axis: a kilometre."""

DEEPEST_TREE = 100
"""Most resources on the way from a resource up to the root, both counted."""

_UNREADABLE = re.compile("[\\x00-\\x1f\\x7f-\\x9f\\u2028\\u2029\\u202a-\\u202e\\u2066-\\u2069]")
"""Control characters, and what turns the direction of the text after it.

Source:
    Unicode Standard Annex 9, directional embeddings, overrides and isolates.
"""


def check_bounds(lab: LabFile) -> list[Finding]:
    """List what lies beyond the bounds of any lab; an empty list means nothing does."""
    return [*_check_names(lab), *_check_places(lab), *_check_depth(lab.tree.by_id)]


def _check_names(lab: LabFile) -> Iterator[Finding]:
    named = [("lab", "name", lab.name, lab.name)]
    for sort in ("resources", "materials", "hosts", "devices"):
        for entry in getattr(lab, sort):
            named += [(sort, "key", entry.key, entry.key), (sort, "name", entry.key, entry.name)]
    for sort in ("lots", "connections"):
        named += [(sort, "key", entry.key, entry.key) for entry in getattr(lab, sort)]
    for sort, field, key, text in named:
        found = _UNREADABLE.search(text)
        if found is not None:
            message = (
                f"{sort}[{key!r}]: {field}: has U+{ord(found.group()):04X}, a character that "
                "controls how text is shown"
            )
            yield Finding("lab_file.name", message, key, {"field": field})


def _check_places(lab: LabFile) -> Iterator[Finding]:
    for resource in lab.resources:
        pose = resource.pose
        if pose is None or max(map(abs, (pose.x_mm, pose.y_mm, pose.z_mm))) <= FARTHEST_MM:
            continue
        message = (
            f"resources[{resource.key!r}]: pose: is more than {FARTHEST_MM:g} mm from its parent"
        )
        yield Finding("pose.too_far", message, resource.key, {"field": "pose"})


def _check_depth(by_id: Mapping[UUID, Resource]) -> Iterator[Finding]:
    depth: dict[UUID, int] = {}
    for start in by_id:
        path: list[UUID] = []
        current: UUID | None = start
        while current is not None and current in by_id and current not in depth:
            if len(path) > len(by_id):
                break
            path.append(current)
            current = by_id[current].parent_id
        above = depth.get(current, 0) if current is not None else 0
        for node_id in reversed(path):
            above += 1
            depth[node_id] = above
    too_deep = next((node_id for node_id, found in depth.items() if found > DEEPEST_TREE), None)
    if too_deep is not None:
        key = by_id[too_deep].key
        message = f"resources[{key!r}] stands more than {DEEPEST_TREE} resources deep"
        yield Finding("tree.too_deep", message, key)
