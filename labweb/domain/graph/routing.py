"""Which way liquid takes from one vessel to another, and what has to be switched for it.

flask ──▶ 2│valve│common ──▶ syringe ──▶ common│valve│5 ──▶ reactor
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from uuid import UUID

from labweb.domain.errors import NoRouteError
from labweb.domain.graph.topology import Connection, Medium, PhysicalGraph, PortRef
from labweb.domain.resources.node import Resource
from labweb.domain.resources.tree import Tree

COMMON_PORT = "common"
"""Name of a rotary valve's fixed port, unless its `config.common_port` says otherwise."""

_LISTED = 12
_Label = tuple[int, int, tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class ValvePosition:
    """One rotary valve on a route, and the numbered port its common port must face."""

    valve_id: UUID
    port_index: int


@dataclass(frozen=True, slots=True)
class Route:
    """A way for liquid, from port to port."""

    ports: tuple[PortRef, ...]
    """Both ends of every connection, in order of flow."""

    connections: tuple[Connection, ...]
    valves: tuple[ValvePosition, ...]
    dead_volume_nl: int
    """Of the connections whose dead volume is known."""

    @property
    def resource_ids(self) -> tuple[UUID, ...]:
        """Return every resource on the way once, ends included, in order of flow."""
        return tuple(dict.fromkeys(port.resource_id for port in self.ports))

    @property
    def unknown_keys(self) -> tuple[str, ...]:
        """Return the connections whose dead volume nobody stated."""
        return tuple(c.key for c in self.connections if c.dead_volume_nl is None)


@dataclass(frozen=True, slots=True)
class _Turn:
    """Passing through a valve from one port to another."""

    resource_id: UUID
    entered: str
    left: str


@dataclass(frozen=True, slots=True)
class _Path:
    label: _Label
    ports: tuple[PortRef, ...]
    connections: tuple[Connection, ...]

    @property
    def end(self) -> PortRef:
        return self.ports[-1]

    def turns(self) -> Iterator[_Turn]:
        for entered, left in zip(self.ports[1:-1:2], self.ports[2::2], strict=True):
            yield _Turn(entered.resource_id, entered.port, left.port)


@dataclass(frozen=True)
class _Search:
    """One question, with all that bounds it."""

    graph: PhysicalGraph
    tree: Tree
    source: UUID
    target: UUID
    blocked: frozenset[UUID]
    backwards: bool = False
    through: frozenset[str] = frozenset()
    """Kinds that conduct between any two ports: to explain a refusal, never to plan."""

    @cached_property
    def tees(self) -> frozenset[PortRef]:
        """Ports of valves that more than one tube joins: what flows there is not one way."""
        far: dict[PortRef, set[PortRef]] = {}
        for connection in self.graph.connections:
            far.setdefault(connection.source, set()).add(connection.target)
            far.setdefault(connection.target, set()).add(connection.source)
        return frozenset(port for port, others in far.items() if len(others) > 1)


def find_route(
    graph: PhysicalGraph,
    tree: Tree,
    source: UUID,
    target: UUID,
    *,
    blocked: Collection[UUID] = frozenset(),
) -> Route:
    """Find the way from source to target that wastes the least liquid.

    Connections are directed: a check valve conducts one way, a plain tube both. Only a
    rotary valve lets liquid through, between its common port and one numbered port. A valve
    port that more than one tube joins is not used, because the flow would divide there.

    Cost is dead volume and not length, because dead volume is what a transfer loses;
    unknown dead volume costs nothing and is listed in `Route.unknown_keys`.

    Args:
        graph: The lab's connections; only liquid ones are used.
        tree: Tells the kind of each resource.
        source: Resource the liquid leaves from, by any of its ports.
        target: Resource it must reach, by any of its ports.
        blocked: Resources the way may not enter.

    Returns:
        The cheapest way. Among equals the one with fewer connections, then the one whose
        port names sort first, so that the same lab always gives the same answer.

    Raises:
        NoRouteError: There is none. `context["reached"]` lists what can be reached from the
            source, `context["reaches_target"]` what reaches the target, both in order of
            cost: the gap lies between the last of the one and the last of the other.
            Code `plan.undriven_valve` when only solenoid valves stand in the way.

    Effect:
        None. Nothing is reserved.

    Source:
        Dijkstra, Numerische Mathematik 1 (1959) 269-271, with a binary heap.
    """
    for end in (source, target):
        tree.find(end)
    liquid = graph.restricted(Medium.LIQUID)
    search = _Search(liquid, tree, source, target, frozenset(blocked) - {source, target})
    if source == target:
        raise NoRouteError("source and target are the same vessel", code="plan.same_vessel")
    path = _cheapest(search)
    if path is None:
        raise _explain(search)
    return _render(path, tree)


def is_numbered(port: str) -> bool:
    """Tell whether a port name is the number of a valve position.

    Example:
        >>> is_numbered("3"), is_numbered("0"), is_numbered("common")
        (True, False, False)
    """
    return port.isascii() and port.isdigit() and not port.startswith("0")


def _cheapest(search: _Search) -> _Path | None:
    # No valve is turned to two positions on one way: it could only be entered again by the
    # one tube of its common port, or left again by it, and either is a detour.
    for path in _explore(search):
        if path.end.resource_id == search.target:
            return path
    return None


def _explore(search: _Search) -> Iterator[_Path]:
    """Yield the cheapest path to each port that can be arrived at, in order of cost."""
    heap: list[tuple[_Label, int, _Path]] = []
    count = 0
    for path in _leave(search, _Path((0, 0, ()), (), ()), search.source, None):
        heapq.heappush(heap, (path.label, count, path))
        count += 1
    settled: set[PortRef] = set()
    while heap:
        _, _, path = heapq.heappop(heap)
        if path.end in settled:
            continue
        settled.add(path.end)
        yield path
        if path.end.resource_id in (search.source, search.target):
            continue
        for longer in _leave(search, path, path.end.resource_id, path.end.port):
            if longer.end not in settled:
                heapq.heappush(heap, (longer.label, count, longer))
                count += 1


def _leave(
    search: _Search,
    path: _Path,
    resource_id: UUID,
    entered: str | None,
) -> Iterator[_Path]:
    """Yield the path made longer by each connection that leads on from a resource."""
    resource = search.tree.find(resource_id)
    for own, far, connection in _ways_out(search, resource_id):
        if entered is not None:
            if not _conducts(resource, entered, own, search.through):
                continue
            if not search.tees.isdisjoint(
                (PortRef(resource_id, entered), PortRef(resource_id, own))
            ):
                continue
        if far.resource_id in search.blocked or far.resource_id not in search.tree.by_id:
            continue
        if far.resource_id == search.source:
            continue
        dead, hops, names = path.label
        far_key = search.tree.by_id[far.resource_id].key
        step = (own, far_key, far.port, connection.key)
        label = (dead + (connection.dead_volume_nl or 0), hops + 1, (*names, *step))
        ports = (*path.ports, PortRef(resource_id, own), far)
        yield _Path(label, ports, (*path.connections, connection))


def _ways_out(search: _Search, resource_id: UUID) -> Iterator[tuple[str, PortRef, Connection]]:
    if not search.backwards:
        yield from search.graph.neighbours(resource_id)
        return
    for connection in search.graph.by_resource.get(resource_id, ()):
        if connection.target.resource_id == resource_id:
            yield connection.target.port, connection.source, connection
        elif connection.is_two_way:
            yield connection.source.port, connection.target, connection


def _conducts(resource: Resource, entered: str, left: str, through: frozenset[str]) -> bool:
    if resource.kind in through:
        return True
    if resource.kind != "rotary_valve":
        return False
    common = resource.config.get("common_port", COMMON_PORT)
    ends = {entered, left}
    return len(ends) == 2 and common in ends and is_numbered((ends - {common}).pop())


def _render(path: _Path, tree: Tree) -> Route:
    valves = []
    for turn in path.turns():
        common = tree.find(turn.resource_id).config.get("common_port", COMMON_PORT)
        numbered = turn.left if turn.entered == common else turn.entered
        valves.append(ValvePosition(turn.resource_id, int(numbered)))
    return Route(path.ports, path.connections, tuple(valves), path.label[0])


def _explain(search: _Search) -> NoRouteError:
    tree = search.tree
    source, target = tree.find(search.source), tree.find(search.target)
    reached = [tree.find(path.end.resource_id) for path in _explore(search)]
    mirror = replace(search, source=search.target, target=search.source, backwards=True)
    reaching = [tree.find(path.end.resource_id) for path in _explore(mirror)]
    context = {
        "source": source.key,
        "target": target.key,
        "reached": _keys(reached),
        "reaches_target": _keys(reaching),
        "tees": _tees(search),
    }
    solenoids = _solenoids_on_the_way(search)
    if solenoids:
        names = ", ".join(valve.name for valve in solenoids)
        return NoRouteError(
            f"the way from {source.name} to {target.name} leads through the solenoid valve "
            f"{names}, which is not driven",
            code="plan.undriven_valve",
            context={**context, "valves": _keys(solenoids)},
        )
    return NoRouteError(
        f"no liquid way from {source.name} to {target.name}: "
        f"{_sentence(source, reached, 'reaches')}, and "
        f"{_sentence(target, reaching, 'can be reached from')}",
        context=context,
    )


def _solenoids_on_the_way(search: _Search) -> list[Resource]:
    wider = replace(search, through=frozenset({"solenoid_valve"}))
    path = _cheapest(wider)
    if path is None:
        return []
    nodes = (search.tree.find(turn.resource_id) for turn in path.turns())
    return [node for node in nodes if node.kind == "solenoid_valve"]


def _tees(search: _Search) -> list[str]:
    found = (
        f"{tree_node.key}:{port.port}"
        for port in search.tees
        if (tree_node := search.tree.by_id.get(port.resource_id)) is not None
        and tree_node.kind == "rotary_valve"
    )
    return sorted(found)


def _keys(resources: list[Resource]) -> list[str]:
    return list(dict.fromkeys(resource.key for resource in resources))


def _sentence(end: Resource, others: list[Resource], verb: str) -> str:
    names = list(dict.fromkeys(other.name for other in others))
    if not names:
        return f"{end.name} {verb} nothing"
    shown = ", ".join(names[:_LISTED])
    return f"{end.name} {verb} {shown}" + (" and more" if len(names) > _LISTED else "")
