"""A chain of hops: from a vessel into a syringe, from syringe to syringe, into a vessel.

flask ──▶ 2│valve│-1 ──▶ pump 1 ──▶ -1│valve│5 ──▶ 4│valve│-1 ──▶ pump 2 ──▶ … ──▶ reactor
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.hop_table import table_of
from labweb.domain.graph.port_network import Hop, Network

_SYRINGE = 10**6
_NANOLITRE = 10**12
_UNUSUAL = 10**24
"""What a tube costs is 1: a syringe counts more than all tubes, and so on."""


@dataclass(frozen=True, kw_only=True)
class WantedChain:
    """What a chain must be."""

    source: int
    target: int
    source_port: str | None = None
    target_port: str | None = None
    through: tuple[int, ...] = ()
    """Manifolds and cartridges to be passed, in this order."""

    over: int | None = None
    """A syringe that has to be among those on the way; liquid may turn back from it."""


@dataclass(frozen=True, slots=True)
class SyringeChain:
    """The hops of one transfer, in order of flow; every hop but the last ends in a syringe."""

    hops: tuple[Hop, ...]

    @property
    def pumps(self) -> tuple[int, ...]:
        """Return the syringes, in order of flow."""
        return tuple(hop.end for hop in self.hops[:-1])

    @property
    def dead_nl(self) -> int:
        """Return the volume of all tubes on the way, as far as it is known."""
        return sum(hop.dead_nl for hop in self.hops)


@dataclass(slots=True)
class _Reached:
    """A syringe, how much of `through` lies behind it, and the hop that filled it."""

    pump: int
    passed: int
    is_met: bool
    """The syringe that has to be on the way lies behind, or is this one."""

    hop: Hop
    parent: _Reached | None


def find_chain(network: Network, wanted: WantedChain) -> SyringeChain | None:
    """Find the chain that leads from the source to the target, or None.

    The ports that an element is left and entered by, unless others are asked for, count
    first; then dead volume, as far as it is known; then the number of syringes; then the
    number of tubes. Equals are settled by the keys of elements and ports, so the order of
    the file does not matter.
    """
    ways = _Ways(network, wanted)
    heap: list[tuple[int, int, _Reached | SyringeChain]] = []
    found: Iterable[tuple[int, _Reached | SyringeChain]] = ways.first()
    count = 0
    settled: set[tuple[int, int, bool]] = set()
    while True:
        for cost, reached in found:
            heapq.heappush(heap, (cost, count, reached))
            count += 1
        if not heap:
            return None
        cost, _, nearest = heapq.heappop(heap)
        if isinstance(nearest, SyringeChain):
            return nearest
        place = (nearest.pump, nearest.passed, nearest.is_met)
        found = ()
        if place not in settled:
            settled.add(place)
            found = ways.onward(nearest, cost)


def _chain(last: _Reached, hop: Hop) -> SyringeChain:
    hops = [hop]
    reached: _Reached | None = last
    while reached is not None:
        hops.append(reached.hop)
        reached = reached.parent
    return SyringeChain(tuple(reversed(hops)))


class _Ways:
    """The hops that a search may use, and what each costs."""

    def __init__(self, network: Network, wanted: WantedChain) -> None:
        self._network = network
        self._wanted = wanted
        self._passable = frozenset(wanted.through)
        if wanted.through:
            manifolds = (
                place
                for place, element in enumerate(network.elements)
                if element.role is ElementRole.MANIFOLD
            )
            self._passable |= frozenset(manifolds)
        self._table = table_of(network, self._passable)
        self._count = len(wanted.through)

    def first(self) -> Iterator[tuple[int, _Reached | SyringeChain]]:
        """Yield each syringe that the source is drawn into, with its cost."""
        for hop in self._table.relays(self._wanted.source):
            passed = self.progress(hop, 0)
            if passed is not None and self._wanted.source_port in (None, hop.start_port):
                is_met = self._wanted.over in (None, hop.end)
                yield self.cost(hop) + _SYRINGE, _Reached(hop.end, passed, is_met, hop, None)

    def onward(self, last: _Reached, cost: int) -> Iterator[tuple[int, _Reached | SyringeChain]]:
        """Yield each syringe that one pushes into, and the whole chain if it can end here."""
        ends = self._table.deliveries(last.pump, self._wanted.target) if last.is_met else ()
        for hop in ends:
            is_there = self._wanted.target_port in (None, hop.end_port)
            if is_there and self.progress(hop, last.passed) == self._count:
                yield cost + self.cost(hop), _chain(last, hop)
        for hop in self._table.relays(last.pump):
            passed = self.progress(hop, last.passed)
            if passed is not None:
                price = hop.dead_nl * _NANOLITRE + len(hop.tubes) + _SYRINGE
                is_met = last.is_met or hop.end == self._wanted.over
                yield cost + price, _Reached(hop.end, passed, is_met, hop, last)

    def progress(self, hop: Hop, passed: int) -> int | None:
        """Return how much of `through` is passed after a hop; None: in another order."""
        if not hop.passed:
            return passed
        for index in hop.passed:
            if self._network.elements[index].role is ElementRole.MANIFOLD:
                if self._wanted.through[passed : passed + 1] == (index,):
                    passed += 1
            elif self._wanted.through[passed : passed + 1] == (index,):
                passed += 1
            else:
                return None
        return passed

    def cost(self, hop: Hop) -> int:
        elements = self._network.elements
        leave, enter = elements[hop.start].leave_by, elements[hop.end].enter_by
        unusual = 0
        if self._wanted.source_port is None and leave not in (None, hop.start_port):
            unusual += 1
        if self._wanted.target_port is None and enter not in (None, hop.end_port):
            unusual += 1
        return unusual * _UNUSUAL + hop.dead_nl * _NANOLITRE + len(hop.tubes)
