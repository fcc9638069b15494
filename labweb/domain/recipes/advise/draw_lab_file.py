"""A lab file that is changed on paper: resources and connections come in, ports are found.

Source:
    `labweb/domain/graph/lab_file/lab_json_entries.py`, version 1 of the format.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.rig.lab_as_rig import COMMON_PORT
from labweb.domain.recipes.advise.draw_chemputer_graph import Drawing, DrawnPort, NotDrawnError
from labweb.domain.recipes.on_rig.equipment import COLLECT, GASES
from labweb.domain.resources.resource_kinds import VACUUMS

VALVE_PORTS = 8
"""Ports of a valve that is added, beside the common one."""

RECEIVER_ML = 250
"""Size of a flask that vapour condenses in; it is drained after each evaporation."""

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
    "IKARV10": _Word(
        "rotary_evaporator", config=(("min_temperature_c", 18), ("max_temperature_c", 180))
    ),
    "CVC3000": _Word("vacuum_controller", Medium.VACUUM, "inlet"),
    "ChemputerCartridge": _Word("cartridge"),
}
"""Class as a change says it → resource of a lab. What is not here a lab file has no word for, or
no recipe is compiled for it on a lab: it is not drawn."""

_CONFIG = {"min_temp": "min_temperature_c", "max_temp": "max_temperature_c", "takes": "takes"}
_PIECE = frozenset({"rotary_valve", "syringe_pump", "cartridge"})
"""Kinds whose ports are named as a change says."""

_GAS = "gas"
_VAPOUR = "vapour"


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
        if class_ == "IKARV10":
            return self._add_evaporator(wanted, word, fields)
        gas = GASES.get(str(fields.get("chemical")).lower())
        if class_ == "ChemputerCartridge":
            return self._entry(wanted, word, filling=fields["chemical"])
        if gas and "max_volume" in fields:
            raise NotDrawnError(gas)  # No gas comes through tubes for liquid here.
        if gas:
            return self._entry(wanted, replace(word, kind="bottle"), gas=gas)
        kind = "bottle" if word.kind == "flask" and fields.get("chemical") else word.kind
        said: dict[str, Any] = {
            _CONFIG[name]: value for name, value in fields.items() if name in _CONFIG
        }
        key = self._entry(wanted, replace(word, kind=kind), **said)
        self.alter(key, **fields)
        return key

    def _entry(self, wanted: str, word: _Word, parent: str | None = None, **config: Any) -> str:  # noqa: ANN401 - as a kind takes it
        key = self._new_key(wanted)
        entry = {"key": key, "name": key, "kind": word.kind, "parent": parent or self._parent()}
        self.graph["resources"].append(entry | {"config": {**dict(word.config), **config}})
        return key

    def _add_evaporator(self, wanted: str, word: _Word, fields: Mapping[str, object]) -> str:
        """Add a rotary evaporator with a flask on it and one that its vapour condenses in."""
        machine = self._entry(f"evaporator_{wanted}", word)
        flask = self._entry(wanted, _WORDS["ChemputerFlask"], parent=machine)
        self.alter(flask, max_volume=fields["max_volume"])
        self.add_receiver(flask)
        self.cost -= len(("flask", "receiver"))  # They are parts of the one device.
        return flask

    def add_receiver(self, vessel: str) -> str:
        """Add a flask that the vapour of a vessel condenses in, and return its key."""
        key = self._entry(f"{vessel}_receiver", _WORDS["ChemputerFlask"])
        self.alter(key, max_volume=RECEIVER_ML)
        ends = {"resource": vessel, "port": _VAPOUR}, {"resource": key, "port": "condenser"}
        self._connection(*ends, Medium.GAS, is_two_way=False)
        return key

    def parts(self, vessel: str) -> tuple[str, ...]:
        """Return the receiver of a flask on an evaporator that was added, and the evaporator."""
        machine = self._entries[vessel].get("parent")
        if machine not in self.added or self._entries[machine]["kind"] != "rotary_evaporator":
            return ()
        return (self._receiver(vessel), machine)

    def _receiver(self, vessel: str) -> str:
        """Return the flask that the vapour of a vessel condenses in."""
        return next(
            str(link["target"]["resource"])
            for link in self.links
            if link["source"] == {"resource": vessel, "port": _VAPOUR}
            and link["medium"] == Medium.GAS.value
        )

    def lay_gas(self, source: DrawnPort, target: DrawnPort, *, both: bool = False) -> None:
        """Lay a tube for gas."""
        # What a valve is led to a vacuum by carries both ways.
        is_vacuum = self._entries[target.key]["kind"] in VACUUMS
        ends = self._gas_end(source), self._gas_end(target)
        self._connection(*ends, Medium.GAS, is_two_way=both or is_vacuum)

    def _gas_end(self, port: DrawnPort) -> dict[str, str]:
        entry = self._entries[port.key]
        if entry["kind"] in VACUUMS:
            return {"resource": port.key, "port": "inlet"}
        if entry.get("config", {}).get("gas"):
            return {"resource": port.key, "port": "outlet"}
        return {"resource": port.key, "port": port.port}

    def gas_place(self, vessel: str) -> DrawnPort:
        """Return where a tube for gas may be joined to a vessel."""
        used, number, name = self.used(vessel), 1, _GAS
        while name in used:
            number += 1
            name = f"{_GAS}_{number}"
        return DrawnPort(vessel, name)

    def vacuum_lines(self) -> list[str]:
        """Return the vacuums that a valve is joined to: no flask has them to itself."""
        kinds = {key: entry["kind"] for key, entry in self._entries.items()}
        found = set()
        for link in self.links:
            one, other = (link[end]["resource"] for end in ("source", "target"))
            for own, far in ((one, other), (other, one)):
                if kinds[own] in VACUUMS and kinds[far] == "rotary_valve":
                    found.add(own)
        return sorted(found)

    def new_vacuum(self, vessel: str) -> tuple[str, ...]:
        """Add a vacuum controller, which is a line by itself."""
        return (self._entry(f"vacuum_{vessel}", _WORDS["CVC3000"]),)

    def detach(self, device: str, vessel: str) -> bool:
        """Take away the connections that join two resources directly; False: there are none."""
        kept = [
            n
            for n in self.links
            if {n["source"]["resource"], n["target"]["resource"]} != {device, vessel}
        ]
        is_changed = len(kept) < len(self.links)
        self.links[:] = kept
        self._rig = None
        return is_changed

    def is_flask(self, node: Mapping[str, Any]) -> bool:
        """Tell whether a resource is a flask that may be moved; gas is led by its own tubes."""
        entry = self._entries[node["id"]]
        on = self._entries.get(str(entry.get("parent")), {}).get("kind")
        is_gas = bool(entry.get("config", {}).get("gas"))
        return super().is_flask(node) and not is_gas and on != "rotary_evaporator"

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

    def lay(self, source: DrawnPort, target: DrawnPort, *, both: bool = False) -> None:
        """Lay a tube; `both`: it conducts both ways."""
        self._connect(source, target, Medium.LIQUID, is_two_way=both)

    def attach(self, device: str, vessel: str) -> None:
        """Join a device to a vessel that it acts on."""
        kind = self._entries[device]["kind"]
        word = next(word for word in _WORDS.values() if word.kind == kind)
        port = f"{word.port}_{device}" if word.port in self.used(vessel) else word.port
        self._connect(
            DrawnPort(device, word.port), DrawnPort(vessel, port), word.medium, is_two_way=True
        )

    def _connect(
        self, source: DrawnPort, target: DrawnPort, medium: Medium, *, is_two_way: bool
    ) -> None:
        self._connection(self._end(source), self._end(target), medium, is_two_way=is_two_way)

    def _connection(
        self, source: dict[str, str], target: dict[str, str], medium: Medium, *, is_two_way: bool
    ) -> None:
        wanted = f"{source['resource']}_{source['port']}_{target['resource']}"
        self.links.append(
            {"key": _free(wanted, self.links), "source": source, "target": target}
            | {"medium": medium.value, "is_two_way": is_two_way}
        )
        self._rig = None

    def _end(self, port: DrawnPort) -> dict[str, str]:
        """Return an end of a connection; port 0 of a vessel is its next tube."""
        if port.port == COLLECT:
            port = DrawnPort(self._receiver(port.key), "0")
        kind = self._entries[port.key]["kind"]
        name = port.port
        if kind == "syringe_pump":
            name = "outlet"
        elif kind not in _PIECE and name in ("0", "evaporate"):
            name = self.free_port_of(port.key).port
        return {"resource": port.key, "port": name}

    def free_port_of(self, vessel: str) -> DrawnPort:
        """Return the next port for a tube: a vessel of a lab has as many as tubes dip into it."""
        used, number = self.used(vessel), 1
        while f"{_TUBE}{number}" in used:
            number += 1
        return DrawnPort(vessel, f"{_TUBE}{number}")

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

    def _move_tubes(self, flask: str, old: DrawnPort, new: DrawnPort) -> None:
        for link in self.links:
            for end, far in (("source", "target"), ("target", "source")):
                here = link[end]
                if (here["resource"], link[far]["resource"]) == (old.key, flask):
                    link[end] = {"resource": new.key, "port": new.port}
        self._rig = None

    def _movable(self, but_not: str) -> tuple[str, DrawnPort] | None:
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
