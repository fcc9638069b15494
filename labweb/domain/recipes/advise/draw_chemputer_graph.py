"""A Chemputer graph that is changed on paper: nodes and links come in, ports are found."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.rig.node_classes import chemputer_sort
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.on_rig.equipment import Equipment, VesselSort

PUMP_ML = 25
"""Syringe of a pump that is added.

Source:
    Most syringes of the published Chemputer rigs."""

SIZES_ML = (25, 50, 100, 250, 500, 1000, 2000, 5000, 10_000, 20_000)
"""Sizes of common flasks; nothing larger is advised."""

_FLASK = re.compile("flask|bottle")
_VALVE_PORTS = tuple(str(port) for port in range(6))
_DRY = "(,)"
"""Ports of a link that carries no liquid."""


@dataclass(frozen=True, slots=True)
class DrawnPort:
    """A port of a valve or vessel."""

    key: str
    port: str

    def __str__(self) -> str:
        return f"port {self.port} of {self.key}"


@dataclass(frozen=True, slots=True)
class ChangeDrawn:
    """One change as it was drawn."""

    kind: str
    text: Callable[[], str]
    """Said at the end, when the size of what was added is known."""

    adds: tuple[str, ...]


class NotDrawnError(Exception):
    """A graph has no word for what a change would draw."""


class Drawing:
    """A copy of a graph. Changing it changes nothing else."""

    common = "-1"
    """Name of the common port of a valve."""

    def __init__(self, graph: Mapping[str, Any], wanted: frozenset[str] = frozenset()) -> None:
        self._wanted = wanted
        """Reagents and flasks of the recipe: none of them is exchanged."""

        self._rig: Rig | None = None
        self.graph: dict[str, Any] = deepcopy(dict(graph))
        self.done: list[ChangeDrawn] = []
        self.cost = 0
        """Devices that were added or exchanged."""

        self.added: set[str] = set()

    @property
    def nodes(self) -> dict[str, dict[str, Any]]:
        """Return the nodes by id."""
        return {str(node["id"]): node for node in self.graph["nodes"]}

    @property
    def links(self) -> list[dict[str, Any]]:
        """Return the links, to be changed in place."""
        found: list[dict[str, Any]] = self.graph["links" if "links" in self.graph else "edges"]
        return found

    def rig(self) -> Rig:
        """Read the graph as it is drawn."""
        if self._rig is None:
            self._rig = read_rig(json.dumps(self.graph).encode())
        return self._rig

    def bytes(self) -> bytes:
        """Return the file that the drawing is written as."""
        return json.dumps(self.graph, ensure_ascii=False, indent=2).encode() + b"\n"

    def add(self, wanted: str, class_: str, **fields: object) -> str:
        """Add a node and return its id: the wanted one, or the next with a number."""
        key = self._new_key(wanted)
        self.graph["nodes"].append({"id": key, "name": key, "class": class_, **fields})
        return key

    def _new_key(self, wanted: str) -> str:
        known, key, number = self.nodes, wanted, 2
        while key in known:
            key, number = f"{wanted}_{number}", number + 1
        self._rig = None
        self.added.add(key)
        self.cost += 1
        return key

    def alter(self, key: str, **fields: object) -> None:
        """Change what a node says."""
        self.nodes[key].update(fields)
        self._rig = None

    def lay(self, source: DrawnPort, target: DrawnPort, *, both: bool = False) -> None:
        """Lay a tube; `both`: it conducts both ways."""
        pairs = [(source, target), (target, source)] if both else [(source, target)]
        for one, other in pairs:
            self._link(one.key, other.key, f"({one.port},{other.port})")

    def lay_gas(self, source: DrawnPort, target: DrawnPort, *, both: bool = False) -> None:
        """Lay a tube for gas or vacuum."""
        self.lay(source, target, both=both)

    def gas_place(self, vessel: str) -> DrawnPort | None:
        """Return where a tube for gas may be joined to a vessel."""
        is_filter = Equipment(self.rig()).sort(vessel) is VesselSort.FILTER
        return DrawnPort(vessel, "bottom") if is_filter else self.free_port_of(vessel)

    def vacuum_lines(self) -> list[str]:
        """Return the vacuum lines that a valve can be joined to, by id."""
        return [k for k, e in sorted(self.nodes.items()) if e.get("class") == "ChemputerVacuum"]

    def new_vacuum(self, vessel: str) -> tuple[str, ...]:
        """Add a vacuum line for a vessel; return its pump and the line, which may be one."""
        pump = self.add(f"vacuum_pump_{vessel}", "CVC3000", type="vacuum")
        line = self.add(f"vacuum_{vessel}", "ChemputerVacuum", type="vacuum")
        self.attach(pump, line)
        return (pump, line)

    def parts(self, _vessel: str) -> tuple[str, ...]:
        """Return what came with a vessel as resources of their own, its receiver first."""
        return ()

    def add_receiver(self, _vessel: str) -> str:
        """Add a flask that the vapour of a vessel condenses in, and return its key.

        Raises:
            NotDrawnError: Its own is a part of each rotary evaporator here.
        """
        raise NotDrawnError("receiver")

    def attach(self, device: str, vessel: str) -> None:
        """Join a device to a vessel that it acts on."""
        self._link(device, vessel, _DRY)

    def detach(self, device: str, vessel: str) -> bool:
        """Take away the links that join two nodes directly; False: there are none."""
        kept = [n for n in self.links if {str(n["source"]), str(n["target"])} != {device, vessel}]
        is_changed = len(kept) < len(self.links)
        self.links[:] = kept
        self._rig = None
        return is_changed

    def _link(self, source: str, target: str, port: str) -> None:
        ids = [link["id"] for link in self.links if isinstance(link.get("id"), int)]
        number = max(ids, default=-1) + 1
        self.links.append({"id": number, "source": source, "target": target, "port": port})
        self._rig = None

    def say(self, kind: str, text: Callable[[], str], *adds: str) -> None:
        """Note what was changed."""
        self.done.append(ChangeDrawn(kind, text, adds))

    def size(self, key: str) -> str:
        """Return how large a vessel is, as text in front of its name."""
        size_ml = self.nodes[key].get("max_volume")
        return "" if size_ml is None else f" of {size_ml} mL"

    def used(self, key: str) -> set[str]:
        """Return the ports of a node that tubes are joined to."""
        rig = self.rig()
        out = {tube.source_port for tube in rig.tubes if tube.source == key}
        return out | {tube.target_port for tube in rig.tubes if tube.target == key}

    def free_port_of(self, vessel: str) -> DrawnPort | None:
        """Return a port of a vessel that has no tube; None: all have one."""
        sort = chemputer_sort(str(self.nodes[vessel].get("class")))
        names = sorted((sort and sort.ports) or {"0", "1", "2", "3"})
        used = self.used(vessel)
        return next((DrawnPort(vessel, name) for name in names if name not in used), None)

    def vacant_port(self, valve: str = "", but_not: str = "") -> DrawnPort | None:
        """Return a port without a tube, of one valve or of the backbone; None: there is none.

        The valve with the most free ports comes first, so that tubes are spread.
        """
        valves = [valve] if valve else [key for key in self.backbone() if key != but_not]
        free = {
            key: [p for p in self.valve_ports(key) if p not in self.used(key)] for key in valves
        }
        best = min(free, key=lambda key: (-len(free[key]), key), default=None)
        return DrawnPort(best, free[best][0]) if best is not None and free[best] else None

    def valve_ports(self, _key: str) -> tuple[str, ...]:
        """Return the ports of a valve beside the common one."""
        return _VALVE_PORTS

    def free_port(self, *, but_not: str = "") -> DrawnPort | None:
        """Return a free port of the backbone, made by one more valve where there is none."""
        return self.vacant_port(but_not=but_not) or self.longer(but_not)

    def idle_flask(self) -> str | None:
        """Return a flask of a reagent that the recipe does not use."""
        equipment = Equipment(self.rig())
        for key, sort in equipment.vessels.items():
            chemical = equipment.chemical(key)
            is_idle = sort is VesselSort.FLASK and chemical and not {key, chemical} & self._wanted
            if is_idle and key not in self.added:
                return key
        return None

    def backbone(self) -> list[str]:
        """Return the valves with a pump that tubes join to each other: the most that there are."""
        rig = self.rig()
        roles = {element.key: element.role for element in rig.elements}
        common = {element.key: element.common_port for element in rig.elements}
        pumped: set[str] = set()
        near: dict[str, set[str]] = {}
        for tube in rig.tubes:
            for own, port, far in (
                (tube.source, tube.source_port, tube.target),
                (tube.target, tube.target_port, tube.source),
            ):
                if roles[own] is ElementRole.VALVE and roles[far] is ElementRole.VALVE:
                    near.setdefault(own, set()).add(far)
                if (roles[own], roles[far]) == (
                    ElementRole.VALVE,
                    ElementRole.PUMP,
                ) and port == common[own]:
                    pumped.add(own)
        parts = list(_parts(sorted(pumped), near))
        return max(parts, key=len, default=[])

    def longer(self, but_not: str = "") -> DrawnPort | None:
        """Put one more valve with a pump in place of a flask, which moves to the new valve."""
        found = self._movable(but_not)
        if found is None:
            return None
        flask, place = found
        valve = self.add("valve_more", "ChemputerValve", type="valve")
        pump = self.add("pump_more", "ChemputerPump", type="pump", max_volume=PUMP_ML)
        self.lay(DrawnPort(pump, "0"), DrawnPort(valve, self.common), both=True)
        first, second, *_, last = self.valve_ports(valve)
        self._move_tubes(flask, place, DrawnPort(valve, first))
        self.lay(place, DrawnPort(valve, last), both=True)
        text = f"Put valve {valve} with pump {pump} ({PUMP_ML} mL) at {place}"
        if flask not in self.added:
            text += f", where {flask} is; {flask} moves to {DrawnPort(valve, first)}"
        self.say("add_valve", lambda: text, valve, pump)
        return DrawnPort(valve, second)

    def _move_tubes(self, flask: str, old: DrawnPort, new: DrawnPort) -> None:
        """Lead the tubes between a flask and a valve to another valve."""
        for link in self.links:
            for end, far, side in (("source", "target", 0), ("target", "source", 1)):
                ports = str(link.get("port")).strip("()").split(",")
                if (str(link[end]), str(link[far])) == (old.key, flask):
                    ports[side] = new.port
                    link |= {end: new.key, "port": f"({ports[0]},{ports[1]})"}
                    link.pop(f"{end}Internal", None)

    def _movable(self, but_not: str) -> tuple[str, DrawnPort] | None:
        """Return a flask with one tube to a valve of the backbone, and that port of the valve."""
        rig = self.rig()
        valves = [key for key in self.backbone() if key != but_not]
        ends: dict[str, set[DrawnPort]] = {}
        busy: Counter[DrawnPort] = Counter()
        for tube in rig.tubes:
            for own, far, port in (
                (tube.source, tube.target, tube.target_port),
                (tube.target, tube.source, tube.source_port),
            ):
                ends.setdefault(own, set()).add(DrawnPort(far, port))
        for own, places in ends.items():
            busy.update(places if self.nodes[own].get("class") else ())
        for key, node in sorted(self.nodes.items()):
            places = ends.get(key, set())
            if self.is_flask(node) and len(places) == 1:
                (place,) = places
                if place.key in valves and busy[place] == 1:
                    return key, place
        return None

    def is_flask(self, node: Mapping[str, Any]) -> bool:
        """Tell whether a node is a flask that may be moved to another valve."""
        return bool(_FLASK.search(str(node.get("class")).lower()))


def _parts(keys: list[str], near: Mapping[str, set[str]]) -> Iterator[list[str]]:
    left = set(keys)
    for key in keys:
        if key not in left:
            continue
        part, waiting = [], [key]
        left.discard(key)
        while waiting:
            one = waiting.pop()
            part.append(one)
            found = near.get(one, set()) & left
            left -= found
            waiting += sorted(found)
        yield sorted(part)


def size_for(needed_ml: float) -> int | None:
    """Return the smallest common flask that holds a volume; None: none does."""
    return next((size for size in SIZES_ML if size >= needed_ml), None)
