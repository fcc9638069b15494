"""The hops of a network, each found once."""

from __future__ import annotations

from collections.abc import Iterator

from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.port_network import Hop, Network, explore

_MOST_TABLES = 64
"""Tables kept for one network: one without, and some with what requests lead through."""


class HopTable:
    """The hops that begin at each vessel and syringe, as they are asked for."""

    def __init__(self, network: Network, passable: frozenset[int] = frozenset()) -> None:
        """Begin empty; `passable` are the manifolds and cartridges that may be passed."""
        self._network = network
        self._passable = passable
        self._hops: dict[int, tuple[Hop, ...]] = {}
        self._relays: dict[int, tuple[Hop, ...]] = {}
        self._ends: dict[int, dict[int, tuple[Hop, ...]]] = {}

    def hops(self, start: int) -> tuple[Hop, ...]:
        """Return the cheapest hop to each port that ends one; of a vessel, by each port of it."""
        known = self._hops.get(start)
        if known is None:
            known = self._hops[start] = tuple(self._find(start))
        return known

    def relays(self, start: int) -> tuple[Hop, ...]:
        """Return the hops that end in a syringe of known size."""
        known = self._relays.get(start)
        if known is None:
            elements = self._network.elements
            known = self._relays[start] = tuple(
                hop
                for hop in self.hops(start)
                if elements[hop.end].role is ElementRole.PUMP and elements[hop.end].capacity_nl
            )
        return known

    def deliveries(self, start: int, end: int) -> tuple[Hop, ...]:
        """Return the hops that end in one element, by each of its ports."""
        known = self._ends.get(start)
        if known is None:
            known = self._ends[start] = {}
            for hop in self.hops(start):
                known[hop.end] = (*known.get(hop.end, ()), hop)
        return known.get(end, ())

    def _find(self, start: int) -> Iterator[Hop]:
        if self._network.elements[start].role is ElementRole.PUMP:
            yield from explore(self._network, start, passable=self._passable)
            return
        for port in sorted({arc.own_port for arc in self._network.arcs[start]}):
            yield from explore(self._network, start, start_port=port, passable=self._passable)


def table_of(network: Network, passable: frozenset[int] = frozenset()) -> HopTable:
    """Return the table of a network, the same one each time."""
    known = network.tables.get(passable)
    if not isinstance(known, HopTable):
        if len(network.tables) >= _MOST_TABLES:
            network.tables.clear()
        known = network.tables[passable] = HopTable(network, passable)
    return known
