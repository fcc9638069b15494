"""A lab file that is changed on paper: resources and connections come in, ports are found.

Source:
    `labweb/domain/graph/lab_file/entries.py`, version 1 of the format.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from labweb.domain.graph.rig.lab import COMMON_PORT
from labweb.domain.graph.topology import Medium
from labweb.domain.workflows.advise.drawing import Drawing, NotDrawnError, Port

VALVE_PORTS = 8
"""Ports of a valve that is added, beside the common one."""

_UL_PER_ML = 1000
_TUBE = "tube_"
"""Ports of a vessel that a tube dips into are called by this and a number."""


@dataclass(frozen=True, slots=True)
class _Word:
    """How a lab file says what a Chemputer graph says by a class."""

    kind: str
    medium: Medium = Medium.LIQUID
    """What joins it to a vessel that it acts on."""

    port: str = ""
    config: tuple[tuple[str, Any], ...] = ()


_HEATS = (Medium.THERMAL, "jacket")
_WORDS: Mapping[str, _Word] = {
    "ChemputerFlask": _Word("flask"),
    "ChemputerReactor": _Word("reactor"),
    "ChemputerSeparator": _Word("separator"),
    "ChemputerWaste": _Word("waste"),
    "ChemputerValve": _Word("rotary_valve", config=(("ports_count", VALVE_PORTS),)),
    "ChemputerPump": _Word("syringe_pump"),
    "HeiTORQUE_100": _Word("stirrer", Medium.MECHANICAL, "shaft"),
    "heater_chiller": _Word("thermostat", *_HEATS),
    "JULABOCF41": _Word(
        "thermostat", *_HEATS, (("min_temperature_c", -40), ("max_temperature_c", 100))
    ),
    "IKARCTDigital": _Word(
        "heater_stirrer", *_HEATS, (("min_temperature_c", 18), ("max_temperature_c", 360))
    ),
}
"""Class as a change says it → resource of a lab. What is not here a lab file has no word for, or
no recipe is compiled for it on a lab: it is not drawn."""

_CONFIG = {"min_temp": "min_temperature_c", "max_temp": "max_temperature_c"}


class LabDrawing(Drawing):
    """A copy of a `lab.json`. No driver and no instrument is drawn: both are brought by people."""

    common = COMMON_PORT

    @property
    def nodes(self) -> dict[str, dict[str, Any]]:
        """Return the resources by key: their kind as class, their size in millilitres."""
        return {key: _view(entry) for key, entry in self._entries.items()}

    @property
    def _entries(self) -> dict[str, dict[str, Any]]:
        return {entry["key"]: entry for entry in self.graph["resources"]}

    @property
    def links(self) -> list[dict[str, Any]]:
        """Return the connections, to be changed in place."""
        found: list[dict[str, Any]] = self.graph["connections"]
        return found

    def add(self, wanted: str, class_: str, **fields: object) -> str:
        """Add a resource and return its key.

        Raises:
            NotDrawnError: A lab file has no word for it.
        """
        word = _WORDS.get(class_)
        if word is None:
            raise NotDrawnError(class_)
        kind = "bottle" if word.kind == "flask" and fields.get("chemical") else word.kind
        key = self._new_key(wanted)
        config = dict(word.config)
        config |= {_CONFIG[name]: value for name, value in fields.items() if name in _CONFIG}
        entry = {"key": key, "name": key, "kind": kind, "parent": self._parent()}
        self.graph["resources"].append(entry | {"config": config})
        self.alter(key, **fields)
        return key

    def alter(self, key: str, **fields: object) -> None:
        """Change the size of a resource, or put a new lot of a chemical into it, until it is full.

        A lab file says what is in a flask by its contents alone.
        """
        entry = self._entries[key]
        size_ml, chemical = fields.get("max_volume"), fields.get("chemical")
        if isinstance(size_ml, int | float):
            entry.setdefault("config", {})["capacity_ul"] = size_ml * _UL_PER_ML
        if isinstance(chemical, str) and chemical:
            amount_ul = entry["config"].get("capacity_ul")
            if amount_ul is None:
                raise NotDrawnError(chemical)
            entry["contents"] = [{"lot": self._lot(chemical), "amount_ul": amount_ul}]
        elif isinstance(size_ml, int | float) and key in self.added and entry.get("contents"):
            entry["contents"][0]["amount_ul"] = size_ml * _UL_PER_ML
        self._rig = None

    def _lot(self, chemical: str) -> str:
        materials, lots = self.graph.setdefault("materials", []), self.graph.setdefault("lots", [])
        known = {material["name"]: material["key"] for material in materials}
        material = known.get(chemical) or _free(f"material_{chemical}", materials)
        if chemical not in known:
            materials.append({"key": material, "name": chemical})
        lot = _free(f"lot_{chemical}", lots)
        lots.append({"key": lot, "material": material})
        return lot

    def _parent(self) -> str | None:
        """Return what the valves of the lab stand on."""
        valves = [entry for entry in self._entries.values() if entry["kind"] == "rotary_valve"]
        parent: str | None = valves[0]["parent"] if valves else self.graph["resources"][0]["key"]
        return parent

    def lay(self, source: Port, target: Port, *, both: bool = False) -> None:
        """Lay a tube; `both`: it conducts both ways."""
        self._connect(source, target, Medium.LIQUID, is_two_way=both)

    def attach(self, device: str, vessel: str) -> None:
        """Join a device to a vessel that it acts on."""
        kind = self._entries[device]["kind"]
        word = next(word for word in _WORDS.values() if word.kind == kind)
        port = f"{word.port}_{device}" if word.port in self.used(vessel) else word.port
        self._connect(Port(device, word.port), Port(vessel, port), word.medium, is_two_way=True)

    def _connect(self, source: Port, target: Port, medium: Medium, *, is_two_way: bool) -> None:
        ends = [self._end(source), self._end(target)]
        key = _free(f"{source.key}_{ends[0]['port']}_{target.key}", self.links)
        self.links.append(
            {"key": key, "source": ends[0], "target": ends[1], "medium": medium.value}
            | {"is_two_way": is_two_way}
        )
        self._rig = None

    def _end(self, port: Port) -> dict[str, str]:
        """Return an end of a connection; port 0 of a vessel is its next tube."""
        kind = self._entries[port.key]["kind"]
        name = port.port
        if kind == "syringe_pump":
            name = "outlet"
        elif kind != "rotary_valve" and name == "0":
            name = self.free_port_of(port.key).port
        return {"resource": port.key, "port": name}

    def free_port_of(self, vessel: str) -> Port:
        """Return the next port for a tube: a vessel of a lab has as many as tubes dip into it."""
        used, number = self.used(vessel), 1
        while f"{_TUBE}{number}" in used:
            number += 1
        return Port(vessel, f"{_TUBE}{number}")

    def used(self, key: str) -> set[str]:
        """Return the ports of a resource that something is joined to."""
        ends = [link[end] for link in self.links for end in ("source", "target")]
        return {end["port"] for end in ends if end["resource"] == key}

    def valve_ports(self, key: str) -> tuple[str, ...]:
        """Return the ports of a valve beside the common one; none when nobody says how many."""
        config = self._entries[key].get("config", {})
        count = config.get("ports_count") or 0
        ports = (str(number) for number in range(1, count + 1))
        return tuple(port for port in ports if port != config.get("common_port", COMMON_PORT))

    def idle_flask(self) -> None:
        """Return none: what is in a flask of a lab is somebody's."""

    def _move_tubes(self, flask: str, old: Port, new: Port) -> None:
        for link in self.links:
            for end, far in (("source", "target"), ("target", "source")):
                here = link[end]
                if (here["resource"], link[far]["resource"]) == (old.key, flask):
                    link[end] = {"resource": new.key, "port": new.port}
        self._rig = None

    def _movable(self, but_not: str) -> tuple[str, Port] | None:
        """As for any graph, but of flasks that no driver speaks of."""
        bound = {
            key for device in self.graph.get("devices", ()) for key in device["nodes"].values()
        }
        found = super()._movable(but_not)
        return None if found is None or found[0] in bound else found

    def size(self, key: str) -> str:
        """Return how large a vessel is and what is to be filled in, as text before its name."""
        found = super().size(key)
        return f"{found}, full," if found and self._entries[key].get("contents") else found


def _view(entry: Mapping[str, Any]) -> dict[str, Any]:
    capacity_ul = entry.get("config", {}).get("capacity_ul")
    size = {} if capacity_ul is None else {"max_volume": f"{capacity_ul / _UL_PER_ML:g}"}
    return {"id": entry["key"], "class": entry["kind"], **size}


def _free(wanted: str, entries: list[dict[str, Any]]) -> str:
    known, key, number = {entry["key"] for entry in entries}, wanted, 2
    while key in known:
        key, number = f"{wanted}_{number}", number + 1
    return key
