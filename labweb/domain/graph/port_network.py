"""Which ports conduct to which: one network for every search of a way."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from labweb.domain.graph.elements import Element, ElementRole, Tube
from labweb.domain.graph.ports_and_connections import Medium

_CONDUCTING = (ElementRole.VALVE, ElementRole.SOLENOID)
_PASSIVE = (ElementRole.MANIFOLD, ElementRole.CARTRIDGE)
_BRANCHES = (ElementRole.VALVE, ElementRole.CARTRIDGE)
_ANY = "*"
_SOLENOID_TUBES = 2


@dataclass(frozen=True, slots=True)
class Arc:
    """One tube in one of the directions it conducts."""

    own_port: str
    far: int
    far_port: str
    tube: Tube
    dead_nl: int
    backwards: bool = False


@dataclass(frozen=True, slots=True)
class Hop:
    """Liquid moved by one stroke: from one vessel or syringe to the next."""

    start: int
    start_port: str
    end: int
    end_port: str
    tubes: tuple[Tube, ...]
    settings: tuple[tuple[int, str], ...]
    """Element to be set, and where to: a valve, a pump's own valve, or an open solenoid."""

    ports: tuple[tuple[int, str], ...]
    """Both ends of every tube, in order of flow."""

    dead_nl: int
    passed: tuple[int, ...] = ()
    """Manifolds and cartridges on the way."""

    elements: frozenset[int] = frozenset()
    """Everything on the way, ends included."""


@dataclass(slots=True)
class SearchStep:
    """One element reached, and how."""

    element: int
    port: str
    arc: Arc
    parent: SearchStep | None
    position: str | None
    """Where the element it came from stands; None for the first."""

    passed: tuple[int, ...] = ()
    """Manifolds and cartridges that lie behind."""


@dataclass
class Network:
    """Elements and the tubes of one medium between them, ready to be searched.

    The order of the file never matters: everything is sorted by key and port.
    """

    elements: Sequence[Element]
    tubes: Sequence[Tube]
    index: dict[str, int] = field(default_factory=dict)
    arcs: list[list[Arc]] = field(default_factory=list)
    """Per element, each way out of it."""

    joined: list[set[tuple[str, int, str]]] = field(default_factory=list)
    """Per element, own port and far end of each tube, whichever way it conducts."""

    tables: dict[frozenset[int], object] = field(default_factory=dict)
    """Hops that were found already, by what they may pass (`hops.table_of`)."""

    around: list[list[tuple[Arc, str]]] | None = None
    """Each way out of each element, also where no liquid flows, with why (`breaks`)."""

    islands: list[int] | None = None
    """Per element, a number that all that links join to it share (`breaks`)."""

    _into: dict[tuple[int, str], set[tuple[int, str]]] = field(default_factory=dict)
    _out_of: dict[tuple[int, str], set[tuple[int, str]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Sort everything and count what joins each port."""
        self.elements = sorted(self.elements, key=lambda element: element.key)
        self.index = {element.key: place for place, element in enumerate(self.elements)}
        self.arcs = [[] for _ in self.elements]
        self.joined = [set() for _ in self.elements]
        for tube in self.tubes:
            if tube.medium is Medium.LIQUID:
                self._join(tube)
        for arcs in self.arcs:
            arcs.sort(
                key=lambda arc: (
                    arc.own_port,
                    self.elements[arc.far].key,
                    arc.far_port,
                    arc.tube.key,
                )
            )

    def _join(self, tube: Tube) -> None:
        source, target = self.index.get(tube.source), self.index.get(tube.target)
        if source is None or target is None:
            return
        dead_nl = tube.dead_volume_nl or 0
        ends = ((source, tube.source_port), (target, tube.target_port))
        self._conduct(
            ends[0], ends[1], Arc(tube.source_port, target, tube.target_port, tube, dead_nl)
        )
        if tube.is_two_way:
            back = Arc(tube.target_port, source, tube.source_port, tube, dead_nl, backwards=True)
            self._conduct(ends[1], ends[0], back)

    def _conduct(self, start: tuple[int, str], end: tuple[int, str], arc: Arc) -> None:
        if start[0] != end[0]:  # a tube between two ports of one element leads nowhere else
            self.arcs[start[0]].append(arc)
        self.joined[start[0]].add((start[1], *end))
        self.joined[end[0]].add((end[1], *start))
        self._out_of.setdefault(self.joint(*start), set()).add(self._far(*end))
        self._into.setdefault(self.joint(*end), set()).add(self._far(*start))

    def joint(self, index: int, port: str) -> tuple[int, str]:
        """Return where tubes meet: a port, or the whole of what joins all of its ports."""
        element = self.elements[index]
        bare = element.role is ElementRole.PUMP and not element.selects
        return (index, _ANY if bare or element.role is ElementRole.MANIFOLD else port)

    def _far(self, index: int, port: str) -> tuple[int, str]:
        """Two ports of one vessel are one place to be: its liquid is drawn or added to."""
        return (index, _ANY if self.elements[index].role is ElementRole.VESSEL else port)

    def divides(self, index: int, port: str, *taken: tuple[int, str], drawn: bool) -> bool:
        """Tell whether liquid drawn in (or pushed out) at a port has more than one way.

        A solenoid ends a way, for it is closed wherever the liquid does not pass it. So does, at
        a manifold, what leads on to a valve, which stands elsewhere: as in carousels of cartridges.

        Args:
            index: The element.
            port: Port of it where tubes meet.
            taken: Element and port at the far end of each tube that the liquid passes there;
                none asks for any of them.
            drawn: Liquid is drawn, not pushed.
        """
        found = (self._into if drawn else self._out_of).get(self.joint(index, port), set())
        if not taken and len(found) <= 1:
            return False
        others = found - {self._far(*far) for far in taken}
        if self.elements[index].role is ElementRole.MANIFOLD:
            others = {far for far in others if self.elements[far[0]].role not in _BRANCHES}
        return any(not self.closes(far) for far, _ in others)

    def closes(self, index: int) -> bool:
        """Tell whether an element is a solenoid with a tube at either side and no more."""
        if self.elements[index].role is not ElementRole.SOLENOID:
            return False
        sides = [port for port, _, _ in self.joined[index] if port]
        return len(self.joined[index]) <= _SOLENOID_TUBES and len(sides) == len(set(sides))


def explore(
    network: Network,
    start: int,
    *,
    start_port: str | None = None,
    passable: frozenset[int] = frozenset(),
) -> Iterator[Hop]:
    """Yield the cheapest hop to each port that ends one, in order of cost.

    Cost is dead volume, then the number of tubes; equals are settled by key and port.
    Valves and open solenoids conduct, and of the rest only what is `passable`. A port at
    which the flow would divide is not used.
    """
    search = PortSearch(network, start, start_port=start_port, passable=passable)
    for dead_nl, step in search.settle():
        if search.ends(step):
            hop = make_hop(network, start, step, dead_nl)
            if hop is not None:
                yield hop


@dataclass(frozen=True, kw_only=True)
class _Bounds:
    start_port: str | None
    passable: frozenset[int]
    blocked: frozenset[int]
    drawn: bool


class PortSearch:
    """One search from a vessel or syringe, along what conducts.

    Source:
        Dijkstra, Numerische Mathematik 1 (1959) 269-271, with a binary heap.
    """

    def __init__(
        self,
        network: Network,
        start: int,
        *,
        start_port: str | None = None,
        passable: frozenset[int] = frozenset(),
        blocked: frozenset[int] = frozenset(),
        drawn: bool | None = None,
    ) -> None:
        """Begin at `start`.

        Args:
            network: Where to search.
            start: Vessel or syringe.
            start_port: The only port to leave it by, when given.
            passable: Manifolds and cartridges that may be passed.
            blocked: Elements never entered.
            drawn: Liquid is drawn out of `start`; otherwise it is pushed. By default it is
                pushed when `start` is a syringe.
        """
        if drawn is None:
            drawn = network.elements[start].role is not ElementRole.PUMP
        self._network = network
        self._start = start
        self._bounds = _Bounds(
            start_port=start_port, passable=passable, blocked=blocked | {start}, drawn=drawn
        )
        self._heap: list[tuple[int, int, int, SearchStep]] = []
        self._count = 0
        self._settled: set[tuple[int, str, tuple[int, ...]]] = set()

    def ends(self, step: SearchStep) -> bool:
        """Tell whether liquid stops at an element: it neither conducts nor may be passed."""
        role = self._network.elements[step.element].role
        return role not in _CONDUCTING and step.element not in self._bounds.passable

    def settle(self) -> Iterator[tuple[int, SearchStep]]:
        """Yield (dead volume, step) for each port that can be reached, in order of cost."""
        self._leave()
        while self._heap:
            dead_nl, length, _, step = heapq.heappop(self._heap)
            place = (step.element, step.port, step.passed)
            if place in self._settled:
                continue
            self._settled.add(place)
            yield dead_nl, step
            if not self.ends(step):
                self._go_on(step, dead_nl, length)

    def _leave(self) -> None:
        network, bounds = self._network, self._bounds
        for arc in network.arcs[self._start]:
            if bounds.start_port not in (None, arc.own_port) or arc.far in bounds.blocked:
                continue
            far = (arc.far, arc.far_port)
            if bounds.drawn or not network.divides(self._start, arc.own_port, far, drawn=False):
                self._push(arc.dead_nl, 1, SearchStep(arc.far, arc.far_port, arc, None, None))

    def _go_on(self, step: SearchStep, dead_nl: int, length: int) -> None:
        passed = step.passed
        if self._network.elements[step.element].role not in _CONDUCTING:
            if step.element in passed:
                return
            passed = (*passed, step.element)
        for arc in self._network.arcs[step.element]:
            if (arc.far, arc.far_port, passed) in self._settled or arc.far in self._bounds.blocked:
                continue
            position = _passes(self._network, step, arc, drawn=self._bounds.drawn)
            if position is not None:
                longer = SearchStep(arc.far, arc.far_port, arc, step, position, passed)
                self._push(dead_nl + arc.dead_nl, length + 1, longer)

    def _push(self, dead_nl: int, length: int, step: SearchStep) -> None:
        heapq.heappush(self._heap, (dead_nl, length, self._count, step))
        self._count += 1


def _passes(network: Network, step: SearchStep, arc: Arc, *, drawn: bool) -> str | None:
    """Return where the element stands that liquid passes from `step` to `arc`, if it can."""
    position = conducts(network, step.element, step.port, arc)
    if position is None:
        return None
    tube = step.arc.tube
    came_from = network.index[tube.target if step.arc.backwards else tube.source]
    ends = (
        ((step.element, step.port), (came_from, step.arc.own_port)),
        ((step.element, arc.own_port), (arc.far, arc.far_port)),
    )
    if _divides_at(network, ends, drawn=drawn):
        return None
    if step.arc.tube is arc.tube:
        return None
    return position if _agrees(step, position) else None


def conducts(network: Network, index: int, entered: str, arc: Arc) -> str | None:
    """Return the position in which an element joins a port to an arc out of it."""
    element = network.elements[index]
    if element.role is ElementRole.VALVE:
        return element.position(entered, arc.own_port)
    if element.role is ElementRole.SOLENOID:
        return "open" if network.closes(index) else None
    if element.role in _PASSIVE:
        return "" if entered != arc.own_port or element.role is ElementRole.MANIFOLD else None
    return None


def _agrees(step: SearchStep, position: str) -> bool:
    """Tell whether no valve on the way would have to stand at two positions."""
    later: SearchStep = step
    while later.parent is not None:
        if later.parent.element == step.element and later.position != position:
            return False
        later = later.parent
    return True


def make_hop(network: Network, start: int, step: SearchStep, dead_nl: int) -> Hop | None:
    """Make a hop of the steps to its end, unless its end cannot be one."""
    steps = [step]
    while steps[-1].parent is not None:
        steps.append(steps[-1].parent)
    steps.reverse()
    ports: list[tuple[int, str]] = []
    here = start
    for each in steps:
        ports += [(here, each.arc.own_port), (each.element, each.port)]
        here = each.element
    if network.elements[here].role is ElementRole.PUMP and _draws_elsewhere(network, ports):
        return None
    inner = [
        (before.element, after.position)
        for before, after in pairwise(steps)
        if after.position is not None
    ]
    settings = dict(place for place in inner if place[1])
    for index, port in (ports[0], ports[-1]):
        if network.elements[index].selects:
            if not port:
                return None
            settings[index] = port
    tubes = tuple(each.arc.tube for each in steps)
    return Hop(
        start, ports[0][1], here, ports[-1][1], tubes, tuple(settings.items()), tuple(ports),
        dead_nl, step.passed, frozenset(index for index, _ in ports),
    )  # fmt: skip


def _draws_elsewhere(network: Network, ports: Sequence[tuple[int, str]]) -> bool:
    """Tell whether the syringe at the end would draw from more than this one way.

    Both ends of every tube stand in `ports`, one beside the other.
    """
    ends = [(end, ports[place ^ 1]) for place, end in enumerate(ports) if place]
    return _divides_at(network, ends, drawn=True)


def _divides_at(
    network: Network, ends: Iterable[tuple[tuple[int, str], tuple[int, str]]], *, drawn: bool
) -> bool:
    """Tell whether liquid has yet another way at an end of a tube; beside it the other end."""
    taken: dict[tuple[int, str], list[tuple[int, str]]] = {}
    for near, far in ends:
        taken.setdefault(network.joint(*near), []).append(far)
    return any(
        network.divides(index, port, *fars, drawn=drawn) for (index, port), fars in taken.items()
    )
