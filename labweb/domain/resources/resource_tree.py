"""The resource tree: one root, one parent each, no cycle."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar
from uuid import UUID

from labweb.domain.errors import Finding, NotFoundError
from labweb.domain.resources.resource import Resource


@dataclass(frozen=True)
class Tree:
    """Resources by id, with parent links."""

    resources: tuple[Resource, ...]

    @cached_property
    def by_id(self) -> dict[UUID, Resource]:
        """Resource by id."""
        return {resource.id: resource for resource in self.resources}

    @cached_property
    def by_key(self) -> dict[str, Resource]:
        """Resource by its id in the lab file."""
        return {resource.key: resource for resource in self.resources}

    @cached_property
    def children(self) -> dict[UUID | None, list[Resource]]:
        """Children by parent id, in the order given."""
        found: dict[UUID | None, list[Resource]] = {}
        for resource in self.resources:
            found.setdefault(resource.parent_id, []).append(resource)
        return found

    def find(self, resource_id: UUID) -> Resource:
        """Return the resource.

        Raises:
            NotFoundError: It is not in this tree.
        """
        try:
            return self.by_id[resource_id]
        except KeyError:
            raise NotFoundError(f"no resource {resource_id}", code="resource.not_found") from None

    def ancestors(self, resource_id: UUID) -> Iterator[Resource]:
        """Yield parent, grandparent, … up to the root."""
        parent_id = self.find(resource_id).parent_id
        while parent_id is not None and parent_id in self.by_id:
            parent = self.by_id[parent_id]
            yield parent
            parent_id = parent.parent_id

    def descendants(self, resource_id: UUID) -> Iterator[Resource]:
        """Yield everything below, parents before children."""
        for child in self.children.get(resource_id, ()):
            yield child
            yield from self.descendants(child.id)


T = TypeVar("T")


def in_tree_order(nodes: Sequence[T], place: Callable[[T], tuple[UUID, UUID | None]]) -> list[T]:
    """Order nodes so that each is followed by all below it; siblings keep their order.

    Args:
        nodes: A tree or a part of one: what has no parent among them stands at the top.
        place: Id and parent of a node.
    """
    known = {place(node)[0] for node in nodes}
    children: dict[UUID | None, list[T]] = {}
    for node in nodes:
        parent = place(node)[1]
        children.setdefault(parent if parent in known else None, []).append(node)
    ordered: list[T] = []
    waiting = children.get(None, [])[::-1]
    while waiting:
        node = waiting.pop()
        ordered.append(node)
        waiting += children.get(place(node)[0], [])[::-1]
    return ordered


def check_tree(resources: Iterable[Resource]) -> list[Finding]:
    """List every way in which the resources are no tree; an empty list means they are."""
    nodes = list(resources)
    findings = [
        Finding("tree.duplicate", f"{count} nodes have the id {key!r}", key)
        for key, count in Counter(node.key for node in nodes).items()
        if count > 1
    ]
    by_id = {node.id: node for node in nodes}
    findings += [
        Finding("tree.dangling_parent", f"parent of {node.key!r} is not in the file", node.key)
        for node in nodes
        if node.parent_id is not None and node.parent_id not in by_id
    ]
    return findings + _check_cycles(by_id)


def _check_cycles(by_id: dict[UUID, Resource]) -> list[Finding]:
    findings: list[Finding] = []
    settled: set[UUID] = set()
    for start in by_id.values():
        path: list[UUID] = []
        seen: set[UUID] = set()
        current: UUID | None = start.id
        while current is not None and current in by_id and current not in settled:
            if current in seen:
                ring = [by_id[node_id].key for node_id in path[path.index(current) :]]
                text = " → ".join([*ring, ring[0]])
                findings.append(Finding("tree.cycle", f"parents form a ring: {text}", ring[0]))
                break
            seen.add(current)
            path.append(current)
            current = by_id[current].parent_id
        settled.update(path)
    return findings
