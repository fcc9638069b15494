"""Which way liquid takes from one vessel to another, and what has to be switched for it.

flask ──▶ 2│valve│common ──▶ syringe ──▶ common│valve│5 ──▶ reactor
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from uuid import UUID

from labweb.domain.errors import NoRouteError
from labweb.domain.graph.elements import Element, ElementRole, Tube, is_numbered
from labweb.domain.graph.port_network import Network, PortSearch, SearchStep, make_hop
from labweb.domain.graph.ports_and_connections import Connection, PhysicalGraph, PortRef
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_tree import Tree

__all__ = ["COMMON_PORT", "Route", "ValvePosition", "find_route", "is_numbered"]

COMMON_PORT = "common"
"""Name of a rotary valve's fixed port, unless its `config.common_port` says otherwise."""

_LISTED = 12
_ROTARY, _SOLENOID = "rotary_valve", "solenoid_valve"
_PASSED = (_ROTARY, _SOLENOID)
"""What liquid passes on its way, unless it begins or ends there."""


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


@dataclass(frozen=True)
class _Plumbing:
    """The liquid connections of a lab as a network, for all questions that may share it."""

    graph: PhysicalGraph
    tree: Tree
    ends: frozenset[UUID]
    """Of a question: those that otherwise let liquid pass, or that nothing is joined to."""

    backwards: bool
    through_solenoids: bool

    @cached_property
    def resources(self) -> list[Resource]:
        """Everything that a liquid connection joins, in the order of the network."""
        ids = {*_joined(self.graph), *self.ends}
        found = [self.tree.by_id[each] for each in ids if each in self.tree.by_id]
        return sorted(found, key=_key)

    @cached_property
    def places(self) -> dict[UUID, int]:
        """Place of each resource in the network."""
        return {resource.id: index for index, resource in enumerate(self.resources)}

    @cached_property
    def connections(self) -> dict[str, Connection]:
        """Connections by their place in the file: keys need not differ."""
        return {
            f"{connection.key}\0{connection.id}": connection
            for connection in self.graph.connections
        }

    @cached_property
    def network(self) -> Network:
        """The liquid connections as a network; drawn backwards when asked from the target."""
        keys = {resource.id: _key(resource) for resource in self.resources}
        tubes = [
            _tube(key, connection, keys, backwards=self.backwards)
            for key, connection in self.connections.items()
            if connection.source.resource_id in keys and connection.target.resource_id in keys
        ]
        elements = [
            _element(each, solenoids=self.through_solenoids, ends=self.ends)
            for each in self.resources
        ]
        return Network(elements, tubes)


@dataclass(frozen=True)
class _Question:
    """One question, with all that bounds it."""

    graph: PhysicalGraph
    tree: Tree
    source: UUID
    target: UUID
    blocked: frozenset[UUID]
    backwards: bool = False
    through_solenoids: bool = False
    """To explain a refusal, never to plan."""

    @cached_property
    def plumbing(self) -> _Plumbing:
        """What it is asked of; made once for all questions on one lab that may share it."""
        joined = _joined(self.graph)
        ends = frozenset(
            end
            for end in (self.source, self.target)
            if end not in joined or self.tree.find(end).kind in _PASSED
        )
        made = _Plumbing(self.graph, self.tree, ends, self.backwards, self.through_solenoids)
        key = (id(self.tree), ends, self.backwards, self.through_solenoids)
        # What is kept holds the tree, so that no other one has its number meanwhile.
        found: _Plumbing = self.graph.kept.setdefault(key, made)
        return found

    @property
    def resources(self) -> list[Resource]:
        """Everything that a liquid connection joins, in the order of the network."""
        return self.plumbing.resources

    def search(self) -> PortSearch:
        """Begin at the source."""
        place = self.plumbing.places
        is_pump = self.tree.find(self.source).kind == "syringe_pump"
        return PortSearch(
            self.plumbing.network,
            place[self.source],
            blocked=frozenset(place[each] for each in self.blocked if each in place),
            drawn=is_pump if self.backwards else not is_pump,
        )


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
    port at which the flow would divide is not used.

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
    """
    for end in (source, target):
        tree.find(end)
    question = _Question(graph.liquid, tree, source, target, frozenset(blocked) - {source, target})
    if source == target:
        raise NoRouteError("source and target are the same vessel", code="plan.same_vessel")
    found = _cheapest(question)
    if found is None:
        raise _explain(question)
    return _render(question, *found)


def _joined(graph: PhysicalGraph) -> Collection[UUID]:
    """Return what any connection of a graph joins."""
    return graph.by_resource.keys()


def _key(resource: Resource) -> str:
    return f"{resource.key}\0{resource.id}"


def _tube(key: str, connection: Connection, keys: dict[UUID, str], *, backwards: bool) -> Tube:
    ends = (connection.source, connection.target)
    source, target = reversed(ends) if backwards else ends
    return Tube(
        key=key,
        source=keys[source.resource_id],
        source_port=source.port,
        target=keys[target.resource_id],
        target_port=target.port,
        medium=connection.medium,
        is_two_way=connection.is_two_way,
        dead_volume_nl=connection.dead_volume_nl,
    )


def _element(resource: Resource, *, solenoids: bool, ends: Collection[UUID]) -> Element:
    """Return what a resource conducts. What a way begins and ends at is never passed."""
    role = ElementRole.OTHER
    if resource.id not in ends:
        if resource.kind == _ROTARY:
            role = ElementRole.VALVE
        elif resource.kind == _SOLENOID and solenoids:
            role = ElementRole.SOLENOID
    common = str(resource.config.get("common_port", COMMON_PORT))
    return Element(
        key=_key(resource), role=role, kind=resource.kind, common_port=common, numbered=True
    )


def _cheapest(question: _Question) -> tuple[int, SearchStep] | None:
    for dead_nl, step in question.search().settle():
        if question.resources[step.element].id == question.target:
            return dead_nl, step
    return None


def _render(question: _Question, dead_nl: int, step: SearchStep) -> Route:
    resources = question.resources
    plumbing = question.plumbing
    hop = make_hop(plumbing.network, plumbing.places[question.source], step, dead_nl)
    if hop is None:  # pragma: no cover - only a syringe's own check refuses a hop
        raise _explain(question)
    ports = tuple(PortRef(resources[index].id, port) for index, port in hop.ports)
    connections = tuple(plumbing.connections[tube.key] for tube in hop.tubes)
    valves = tuple(
        ValvePosition(resources[index].id, int(position)) for index, position in hop.settings
    )
    return Route(ports, connections, valves, dead_nl)


def _explain(question: _Question) -> NoRouteError:
    tree = question.tree
    source, target = tree.find(question.source), tree.find(question.target)
    reached = _reached(question)
    mirror = replace(question, source=question.target, target=question.source, backwards=True)
    reaching = _reached(mirror)
    context = {
        "source": source.key,
        "target": target.key,
        "reached": _keys(reached),
        "reaches_target": _keys(reaching),
        "tees": _tees(question),
    }
    solenoids = _solenoids_on_the_way(question)
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


def _reached(question: _Question) -> list[Resource]:
    return [question.resources[step.element] for _, step in question.search().settle()]


def _solenoids_on_the_way(question: _Question) -> list[Resource]:
    wider = replace(question, through_solenoids=True)
    found = _cheapest(wider)
    names = []
    step = None if found is None else found[1].parent
    while step is not None:
        names.append(wider.resources[step.element])
        step = step.parent
    return [node for node in reversed(names) if node.kind == _SOLENOID]


def _tees(question: _Question) -> list[str]:
    far: dict[PortRef, set[PortRef]] = {}
    for connection in question.graph.connections:
        far.setdefault(connection.source, set()).add(connection.target)
        far.setdefault(connection.target, set()).add(connection.source)
    return sorted(
        f"{node.key}:{port.port}"
        for port, others in far.items()
        if len(others) > 1
        and (node := question.tree.by_id.get(port.resource_id)) is not None
        and node.kind == _ROTARY
    )


def _keys(resources: list[Resource]) -> list[str]:
    return list(dict.fromkeys(resource.key for resource in resources))


def _sentence(end: Resource, others: list[Resource], verb: str) -> str:
    names = list(dict.fromkeys(other.name for other in others))
    if not names:
        return f"{end.name} {verb} nothing"
    shown = ", ".join(names[:_LISTED])
    return f"{end.name} {verb} {shown}" + (" and more" if len(names) > _LISTED else "")
