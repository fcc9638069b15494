"""A rig as a Chemputer graph: its classes and ports, and what these have no word for.

Source:
    Classes and ports of the published Chemputer rigs (`rig.classes`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.graph.elements import Element, ElementRole, Tube
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.rig.node_classes import chemputer_sort, instrument_sort
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.recipes.graph_formats.conversion_loss import CHEMPUTER, lost
from labweb.domain.recipes.on_rig.equipment import (
    CARRIES,
    COLLECT,
    Equipment,
    VesselSort,
    is_passive,
)

_NL_PER_ML = 1_000_000
_MOST_PORT = 5
_DRY = "(,)"
_JOINS = frozenset({Medium.THERMAL, Medium.MECHANICAL, Medium.ELECTRICAL, Medium.VACUUM})
_VESSELS: Mapping[VesselSort, tuple[str, str]] = {
    VesselSort.REACTOR: ("ChemputerReactor", "reactor"),
    VesselSort.FILTER: ("ChemputerFilter", "filter"),
    VesselSort.SEPARATOR: ("ChemputerSeparator", "separator"),
    VesselSort.ROTAVAP: ("IKARV10", "rotavap"),
    VesselSort.CENTRIFUGE: ("Centrifuge", "centrifuge"),
    VesselSort.WASTE: ("ChemputerWaste", "waste"),
    VesselSort.FLASK: ("ChemputerFlask", "flask"),
    VesselSort.PLAIN: ("ChemputerFlask", "flask"),
}
_PARTS: Mapping[ElementRole, tuple[str, str]] = {
    ElementRole.VALVE: ("ChemputerValve", "valve"),
    ElementRole.PUMP: ("ChemputerPump", "pump"),
    ElementRole.CARTRIDGE: ("ChemputerCartridge", "cartridge"),
    ElementRole.MANIFOLD: ("ChemputerManifold", "manifold"),
    ElementRole.GAS: ("ChemputerFlask", "flask"),
}
_CLASSES: Mapping[str, str] = {"thermostat": "heater_chiller", "heater": "heater"}
"""Kinds whose own name is no class of an instrument there."""

_NUMBERED: Mapping[VesselSort, int] = {VesselSort.REACTOR: 3}
"""Vessels with so many ports that are numbered from 0; others have one for all their tubes."""

_SIDES = ("bottom", "top")


def to_chemputer(rig: Rig) -> tuple[dict[str, Any], list[Finding]]:
    """Write a rig in classes and ports of Chemputer graphs.

    Returns:
        The graph as nodes and links, and what it does not hold. A tube at a port that its
        class does not have is left out and named: no other port is taken for it.
    """
    writer = _Writer(rig)
    return writer.graph(), writer.findings


class _Writer:
    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._equipment = Equipment(rig)
        self.findings: list[Finding] = []
        self._nodes: dict[str, dict[str, Any]] = {}
        self._links: list[dict[str, Any]] = []
        self._receivers = {
            receiver: key
            for key in self._equipment.vessels
            if self._equipment.evaporator(key) != key
            and (receiver := self._equipment.collecting(key)) is not None
        }
        self._machines = {self._equipment.evaporator(key) for key in self._equipment.vessels}
        self._machines -= self._equipment.vessels.keys()
        self._numbers = {
            element.key: _numbered_from(element, rig.tubes)
            for element in rig.elements
            if element.role is ElementRole.VALVE
        }
        self._taken: dict[str, list[str]] = {}

    def graph(self) -> dict[str, Any]:
        """Return the nodes and links."""
        for element in self._rig.elements:
            self._node(element)
        for tube in self._rig.tubes:
            self._tube(tube)
        return {"nodes": list(self._nodes.values()), "links": self._links}

    def _lose(self, subject: str, message: str) -> None:
        self.findings.append(lost(subject, message, CHEMPUTER))

    def _node(self, element: Element) -> None:
        key, role = element.key, element.role
        if key in self._receivers or key in self._machines:
            return  # They are parts of one node there.
        if role is ElementRole.VALVE and element.positions:
            self._lose(key, "no class there stands for a valve of this sort")
        elif element.selects:
            self._lose(key, "it is pump and valve in one, and no class there is both")
        elif role in _PARTS:
            self._put(key, *_PARTS[role], **self._part(element))
        elif role is ElementRole.VESSEL:
            self._put(key, *_VESSELS[self._equipment.sort(key)], **self._held(key))
        elif role is ElementRole.VACUUM:
            self._vacuum(element)
        elif (class_ := _class_of(element)) is not None:
            self._put(key, class_, "device", **_range(element))
        else:
            self._lose(key, f"no class there stands for a {element.kind or 'thing without class'}")

    def _put(self, key: str, class_: str, type_: str, **fields: object) -> None:
        known = {name: value for name, value in fields.items() if value is not None}
        self._nodes[key] = {"id": key, "name": key, "class": class_, "type": type_, **known}

    def _part(self, element: Element) -> dict[str, Any]:
        if element.role is ElementRole.PUMP:
            return {"max_volume": _ml(element.capacity_nl)}
        if element.role is ElementRole.CARTRIDGE:
            return {"chemical": self._equipment.chemical(element.key)}
        return (
            {"chemical": self._equipment.gas(element.key)}
            if element.role is ElementRole.GAS
            else {}
        )

    def _held(self, key: str) -> dict[str, Any]:
        equipment = self._equipment
        held = equipment.contents(key)
        found: dict[str, Any] = {"max_volume": _ml(equipment.capacity_nl(key))}
        if len(held) > 1:
            names = ", ".join(name for name, _ in held)
            self._lose(key, f"a flask there holds one substance, and this holds {names}")
        elif held:
            found |= {"chemical": held[0][0], "current_volume": _ml(held[0][1])}
        else:
            found |= {"chemical": equipment.chemical(key), "current_volume": 0}
        if equipment.sort(key) is VesselSort.ROTAVAP:
            receiver = next((one for one, own in self._receivers.items() if own == key), "")
            size = equipment.capacity_nl(receiver or f"{key}#{COLLECT}")
            found |= {"collection_flask_volume": _ml(size)}
        if equipment.sort(key) is VesselSort.PLAIN:
            self._lose(key, "what sort of vessel it is, nobody says: it is written as a flask")
        return found

    def _vacuum(self, element: Element) -> None:
        """Write a vacuum: a line, or a pump; a pump that tubes lead to becomes a line with it."""
        if is_passive(element):
            self._put(element.key, "ChemputerVacuum", "vacuum")
            return
        ways = self._equipment.ways.get(element.key, ())
        ends = (self._equipment.elements[far] for _, far, _ in ways)
        is_line = any(end.role is not ElementRole.VESSEL and not is_passive(end) for end in ends)
        if is_line:
            self._put(element.key, "ChemputerVacuum", "vacuum")
            pump = f"{element.key}_pump"
            self._put(pump, "CVC3000", "vacuum")
            self._link(pump, element.key, _DRY)
        else:
            self._put(element.key, "CVC3000", "vacuum")

    def _link(self, source: str, target: str, port: str, dead_volume_nl: int | None = None) -> None:
        ends = {"id": len(self._links), "source": source, "target": target, "port": port}
        volume = {} if dead_volume_nl is None else {"volume": _ml(dead_volume_nl)}
        self._links.append(ends | volume)

    def _tube(self, tube: Tube) -> None:
        ends = [self._end(tube.source, tube.source_port), self._end(tube.target, tube.target_port)]
        (source, one), (target, other) = ends
        if source == target or source not in self._nodes or target not in self._nodes:
            return  # Inside of one node, or at one that was told already.
        if tube.medium in _JOINS and not self._is_tube(tube):
            self._link(source, target, _DRY)
        elif tube.medium not in CARRIES:
            self._lose(tube.key, f"links there carry no {tube.medium.value}")
        else:
            self._lay(tube, (source, one), (target, other))

    def _is_tube(self, tube: Tube) -> bool:
        """Tell whether vacuum comes by a tube; straight at a flask it is a device joined to it."""
        classes = {self._nodes[key]["class"] for key in (tube.source, tube.target)}
        return tube.medium is Medium.VACUUM and "CVC3000" not in classes

    def _lay(self, tube: Tube, *ends: tuple[str, str]) -> None:
        ports = [self._port(key, port, tube) for key, port in ends]
        wrong = [place for place, port in enumerate(ports) if port is None]
        for place in wrong:
            key, port = ends[place]
            class_ = self._nodes[key]["class"]
            self._lose(
                tube.key, f"its port {port or 'without name'} of {key} is none of a {class_}"
            )
        if wrong:
            return
        (one, _), (other, _) = ends
        self._link(one, other, f"({ports[0]},{ports[1]})", tube.dead_volume_nl)
        if tube.is_two_way:
            self._link(other, one, f"({ports[1]},{ports[0]})", tube.dead_volume_nl)

    def _end(self, key: str, port: str) -> tuple[str, str]:
        owner = self._receivers.get(key)
        return (key, port) if owner is None else (owner, COLLECT)

    def _port(self, key: str, port: str, tube: Tube) -> str | None:
        """Return what a port is called there; None: the class has none like it."""
        element = self._equipment.elements[key]
        if element.role is ElementRole.VALVE:
            return self._valve_port(element, port)
        if element.role is ElementRole.CARTRIDGE:
            return next((side for side in ("out", "in") if side in port.lower()), None)
        sort = self._equipment.vessels.get(key)
        if sort in (VesselSort.SEPARATOR, VesselSort.FILTER):
            return next((side for side in _SIDES if side in port.lower()), None)
        if sort is VesselSort.ROTAVAP:
            return COLLECT if port == COLLECT else "evaporate"
        most = None if sort is None else _NUMBERED.get(sort)
        if most is None:
            return "0"
        taken = self._taken.setdefault(key, [])
        name = port or tube.key
        if name not in taken:
            taken.append(name)
        place = taken.index(name)
        return str(place) if place < most else None

    def _valve_port(self, element: Element, port: str) -> str | None:
        if port == element.common_port:
            return "-1"
        first = self._numbers[element.key]
        if first is None or not port.isdigit() or not 0 <= int(port) - first <= _MOST_PORT:
            return None
        return str(int(port) - first)


def _numbered_from(element: Element, tubes: tuple[Tube, ...]) -> int | None:
    """Return what a valve's first port is called, 0 or 1; None: not even that fits."""
    ports = {tube.source_port for tube in tubes if tube.source == element.key}
    ports |= {tube.target_port for tube in tubes if tube.target == element.key}
    ports |= element.ports or frozenset()
    numbers = sorted(int(port) for port in ports if port.isdigit())
    return None if not numbers or numbers[0] < 0 else min(numbers[0], 1)


def _class_of(element: Element) -> str | None:
    """Return the class of an instrument that acts on a vessel; None: there is none for it."""
    kind = _CLASSES.get(element.kind, element.kind)
    is_known = chemputer_sort(kind) is not None or instrument_sort(kind) is not None
    return kind if is_known else None


def _range(element: Element) -> dict[str, Any]:
    """Return what an instrument reaches, as a node says it."""
    config = element.attributes.get("config")
    places = [element.attributes, config if isinstance(config, Mapping) else {}]
    found = {}
    for end in ("min", "max"):
        values = (p.get(n) for p in places for n in (f"{end}_temp", f"{end}_temperature_c"))
        value = next((one for one in values if isinstance(one, int | float)), None)
        if value is not None:
            found[f"{end}_temp"] = value
    return found


def _ml(nanolitres: int | None) -> float | None:
    return None if nanolitres is None else nanolitres / _NL_PER_ML
