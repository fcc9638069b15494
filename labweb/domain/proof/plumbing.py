"""What is joined to what, as valves stand."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from labweb.domain.graph.elements import NL_PER_UL, Element, ElementRole, is_numbered
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.rig.nodes_as_elements import volume_nl
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.stated_volumes import level_nl, listed_nl
from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL

_CARRIES = frozenset((Medium.LIQUID, Medium.GAS, Medium.VACUUM))
_GASES = frozenset(("air", "nitrogen", "argon", "ar", "n2", "hydrogen", "h2"))
COLLECT = "#collect"
_OF_LABS = "capacity_ul"
"""How much a vessel holds in a lab of ours."""

_SIDES = 2
"""Tubes of a solenoid."""


@dataclass(frozen=True, slots=True)
class End:
    """One port of one element."""

    key: str
    port: str


@dataclass(slots=True)
class Stands:
    """How valves stand. What is not named, nobody has turned yet."""

    ports: dict[str, str] = field(default_factory=dict)
    """Valve, or pump with a valve of its own → port or position."""

    opened: set[str] = field(default_factory=set)
    """Solenoids that are open; all others are shut."""


class Plumbing:
    """The graph, read for what conducts."""

    def __init__(self, rig: Rig) -> None:
        bad = {finding.subject for finding in rig.defects}
        self.elements: Mapping[str, Element] = {one.key: one for one in rig.elements}
        self.tubes = tuple(
            tube for tube in rig.tubes if tube.medium in _CARRIES and tube.key not in bad
        )
        self._joined: dict[str, set[str]] = {}
        self._forth: dict[str, list[tuple[str, End]]] = {}
        self._back: dict[str, list[tuple[str, End]]] = {}
        for tube in rig.tubes:
            self._joined.setdefault(tube.source, set()).add(tube.target)
            self._joined.setdefault(tube.target, set()).add(tube.source)
        for element in rig.elements:
            carrier = self.elements.get(str(element.attributes.get("parent")))
            if (
                element.role is ElementRole.VESSEL
                and carrier is not None
                and carrier.role is ElementRole.OTHER
            ):
                self._joined.setdefault(element.key, set()).add(carrier.key)
                self._joined.setdefault(carrier.key, set()).add(element.key)
        for tube in self.tubes:
            self._lay((tube.source, tube.source_port), (tube.target, tube.target_port))
            if tube.is_two_way:
                self._lay((tube.target, tube.target_port), (tube.source, tube.source_port))

    def _lay(self, source: tuple[str, str], target: tuple[str, str]) -> None:
        self._forth.setdefault(source[0], []).append((source[1], End(*target)))
        self._back.setdefault(target[0], []).append((target[1], End(*source)))

    def tubes_of(self, ways: Iterable[Collection[End]]) -> tuple[str, ...]:
        """Return the tubes of which one way took up both ends, in the order of the graph."""
        found = set(map(frozenset, ways))
        return tuple(
            tube.key
            for tube in self.tubes
            if any(
                {
                    End(tube.source, tube.source_port),
                    End(tube.target, tube.target_port),
                }
                <= way
                for way in found
            )
        )

    def neighbours(self, key: str) -> set[str]:
        """Return what any link joins to an element, what it stands on and what stands on it."""
        return self._joined.get(key, set())

    def tubes_at(self, key: str, *, pushing: bool) -> list[tuple[str, End]]:
        """Return own port and far end of each tube that carries away from, or towards, `key`."""
        table = self._forth if pushing else self._back
        return list(dict.fromkeys(table.get(key, ())))

    def ports_of(self, key: str) -> set[str]:
        """Return the ports at which tubes are joined."""
        both = self._forth.get(key, []) + self._back.get(key, [])
        return {port for port, _ in both if port}

    def is_gas(self, key: str) -> bool:
        """Tell whether an element gives gas: by its class, or a flask of a gas by `chemical`."""
        element = self.elements.get(key)
        if element is None:
            return False
        is_named = _label(element).lower() in _GASES
        is_flask = element.role is ElementRole.VESSEL and "flask" in element.kind.lower()
        return element.role is ElementRole.GAS or (is_named and is_flask)

    def is_vessel(self, key: str) -> bool:
        """Tell whether matter can be in it; the collecting flask of a rotary evaporator too."""
        if key.endswith(COLLECT) and key not in self.elements:
            owner = self.elements.get(key.removesuffix(COLLECT))
            return owner is not None and is_evaporator(owner)
        element = self.elements.get(key)
        return element is not None and element.role is ElementRole.VESSEL and not self.is_gas(key)

    def condenses_in(self, vessel: str) -> str | None:
        """Return where the vapour of a vessel goes: its own flask, or down its way for gas."""
        if is_evaporator(self.elements[vessel]):
            return vessel + COLLECT
        ends = [
            tube.target
            for tube in self.tubes
            if tube.medium is Medium.GAS and tube.source == vessel and self.is_vessel(tube.target)
        ]
        return ends[0] if len(ends) == 1 else None

    def evaporates_into(self, vessel: str) -> list[str]:
        """Return the vessels from which a way for gas leads into a vessel, with no valve."""
        return [
            tube.source
            for tube in self.tubes
            if tube.medium is Medium.GAS and tube.target == vessel and self.is_vessel(tube.source)
        ]

    def capacity(self, key: str) -> int | None:
        """Return the units that the graph says a vessel holds; None: it does not say."""
        owner, name = key, "max_volume"
        if key.endswith(COLLECT) and key not in self.elements:
            owner, name = key.removesuffix(COLLECT), "collection_flask_volume"
        element = self.elements[owner]
        units = ((name, element.nl_per_unit), (_OF_LABS, NL_PER_UL if owner == key else 0))
        for said, unit in units:
            for place in _places(element):
                if unit and (found := volume_nl(place.get(said), unit)):
                    return found * UNITS_PER_NL
        return None

    def stated(self, key: str) -> tuple[int, dict[str, int]]:
        """Return the units of liquid that the graph says are in an element, and of each by name.

        Of what is known by the label of its vessel there are no names.
        """
        element, listed = self.elements[key], dict[str, int]()
        for name, amount in listed_nl(element):
            listed[name] = listed.get(name, 0) + amount * UNITS_PER_NL
        level = level_nl(element) * UNITS_PER_NL
        is_labelled = bool(level and _label(element))
        return max(level, sum(listed.values())), {} if is_labelled else listed

    def can_turn(self, element: Element, port: str) -> bool:
        """Tell whether a valve, or a pump with a valve, has that position."""
        if element.positions:
            return port in element.positions
        if element.role is ElementRole.PUMP:
            return element.selects and port in self.ports_of(element.key)
        if element.common_port is None or port == element.common_port:
            return False
        if element.numbered and not is_numbered(port):
            return False
        return port in self.ports_of(element.key) or port in (element.ports or ())

    def is_shut(self, key: str, stands: Stands) -> bool:
        """Tell whether an element is a shut solenoid, with a tube at either side and no more."""
        if self.elements[key].role is not ElementRole.SOLENOID or key in stands.opened:
            return False
        tubes = {*self._all_tubes(key)}
        sides = [port for port, _ in tubes if port]
        return len(tubes) <= _SIDES and len(sides) == len(set(sides))

    def passes(
        self, element: Element, entered: End, stands: Stands, *, maybe: bool = False
    ) -> set[str] | None:
        """Return the ports that an element joins to the one entered; None: to all others.

        With `maybe`, a valve that nobody has turned yet may stand anywhere.
        """
        if element.role is ElementRole.SOLENOID:
            return None if element.key in stands.opened else set()
        if element.role in (ElementRole.CARTRIDGE, ElementRole.MANIFOLD):
            return None
        if element.role is not ElementRole.VALVE:
            return set()
        stand = stands.ports.get(element.key)
        if stand is None:
            return self._any_position(element, entered.port) if maybe else set()
        if element.positions:
            pairs = element.positions[stand]
            return {p for pair in pairs if entered.port in pair for p in pair - {entered.port}}
        pair = {stand, element.common_port or ""}
        return pair - {entered.port} if entered.port in pair else set()

    def _any_position(self, element: Element, port: str) -> set[str]:
        if element.positions:
            pairs = (pair for joined in element.positions.values() for pair in joined)
            return {other for pair in pairs if port in pair for other in pair - {port}}
        if port == element.common_port:
            return self.ports_of(element.key) - {port}
        return {element.common_port or ""}

    def gases_at(self, vessel: str, stands: Stands, *, maybe: bool = False) -> Iterator[End]:
        """Yield each source of gas, vacuum line and pneumatic port that a vessel is joined to."""
        seen: set[End] = set()
        waiting = [far for _, far in self._all_tubes(vessel)]
        while waiting:
            end = waiting.pop()
            if end in seen:
                continue
            seen.add(end)
            element = self.elements[end.key]
            if element.role in (ElementRole.VACUUM, ElementRole.OTHER) or self.is_gas(end.key):
                yield end
                continue
            leave = self.passes(element, end, stands, maybe=maybe)
            for port, far in self._all_tubes(end.key):
                if leave is None or port in leave:
                    waiting.append(far)

    def _all_tubes(self, key: str) -> list[tuple[str, End]]:
        return self._forth.get(key, []) + self._back.get(key, [])


def _places(element: Element) -> Iterator[Mapping[str, Any]]:
    """Yield the objects of a node in which the graph says something of it."""
    yield element.attributes
    for inner in (element.attributes.get(name) for name in ("config", "data")):
        if isinstance(inner, Mapping):
            yield inner


def _label(element: Element) -> str:
    """Return what the graph says at a node that is in it."""
    for place in _places(element):
        chemical = place.get("chemical")
        if isinstance(chemical, str) and chemical.strip():
            return chemical.strip()
    return ""


def is_evaporator(element: Element) -> bool:
    """Tell whether an element is a rotary evaporator: a vessel that boils into another."""
    word = element.kind.lower().replace("_", "")
    return element.role is ElementRole.VESSEL and any(
        part in word for part in ("rotavap", "rotovap", "rv10", "r300")
    )
