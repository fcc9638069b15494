"""A Chemputer graph as a lab of ours, by the classes of its nodes."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.graph.elements import Element, ElementRole, Tube
from labweb.domain.graph.lab_file.lab_json_entries import SCHEMA
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.rig.nodes_as_elements import decimal, volume_nl
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.recipes.graph_formats.conversion_loss import LABWEB, lost, unheld
from labweb.domain.recipes.on_rig.equipment import (
    COLLECT,
    Equipment,
    RigThermostat,
    VesselSort,
    is_passive,
)
from labweb.domain.resources.resource_kinds import VACUUMS

_NL_PER_UL = 1000
_VALVE_PORTS = 6
_COMMON = "-1"
_KINDS: Mapping[VesselSort, str] = {
    VesselSort.REACTOR: "reactor",
    VesselSort.SEPARATOR: "separator",
    VesselSort.FILTER: "filter",
    VesselSort.WASTE: "waste",
    VesselSort.FLASK: "flask",
    VesselSort.ROTAVAP: "flask",
}
_PARTS: Mapping[ElementRole, str] = {
    ElementRole.VALVE: "rotary_valve",
    ElementRole.PUMP: "syringe_pump",
    ElementRole.CARTRIDGE: "cartridge",
}
_SAID = frozenset(
    {"id", "name", "class", "type", "chemical", "current_volume", "max_volume", "min_temp"}
    | {"max_temp", "collection_flask_volume"}
)
_AMOUNTS: Mapping[str, bool] = {
    "current_volume": True,
    "max_volume": True,
    "collection_flask_volume": True,
    "min_temp": False,
    "max_temp": False,
}
"""Fields of a node that are amounts: volumes, else temperatures."""

_EXPECTED: Mapping[bool, str] = {True: "volume in mL", False: "temperature in °C"}
_SAID_OF_LINK = frozenset({"id", "source", "target", "port", "volume", "key"})
_MEDIA: Mapping[str, tuple[Medium, str]] = {
    "heater_stirrer": (Medium.THERMAL, "jacket"),
    "thermostat": (Medium.THERMAL, "jacket"),
    "stirrer": (Medium.MECHANICAL, "shaft"),
    "vacuum_controller": (Medium.VACUUM, "inlet"),
    "vacuum_line": (Medium.VACUUM, "inlet"),
    "transmitter": (Medium.ELECTRICAL, "probe"),
}
"""How a device acts on a vessel, and what that port is called."""


def from_chemputer(rig: Rig, name: str) -> tuple[dict[str, Any], list[Finding]]:
    """Write a Chemputer graph as the plain data of a `lab.json`.

    Args:
        rig: Read from such a graph.
        name: What the lab is called; the graph does not say.

    Returns:
        The lab, in mode sim and without devices, and what it does not hold.
    """
    writer = _Writer(rig, name)
    return writer.lab(), writer.findings


class _Writer:
    def __init__(self, rig: Rig, name: str) -> None:
        self._rig = rig
        self._name = name
        self._equipment = Equipment(rig)
        self.findings: list[Finding] = []
        self._resources: dict[str, dict[str, Any]] = {}
        self._materials: dict[str, dict[str, Any]] = {}
        self._lots: list[dict[str, Any]] = []
        self._taken = {element.key for element in rig.elements}
        """Keys that are given: a key of our own is none of a node."""
        self._lab, self._bench = self._fresh("lab"), self._fresh("bench")
        self._receivers: dict[str, str] = {}
        """Flask that turns on an evaporator → the flask that it condenses into."""
        self._ports: dict[str, dict[str, str]] = {}
        """Vessel → where a tube ends far away → port."""

    def lab(self) -> dict[str, Any]:
        """Return the lab."""
        self._put(self._lab, "lab", name=self._name)["parent"] = None
        self._put(self._bench, "bench", self._lab)
        for element in self._rig.elements:
            self._element(element)
            self._check_amounts(element.key, element.attributes, _AMOUNTS)
            self.findings += unheld(element.key, element.attributes, _SAID, LABWEB)
        connections = self._connections()
        return {
            "schema": SCHEMA,
            "name": self._name,
            "time_zone": "UTC",
            "mode": "sim",
            "materials": list(self._materials.values()),
            "lots": self._lots,
            "resources": list(self._resources.values()),
            "connections": connections,
            "hosts": [],
            "devices": [],
        }

    def _lose(self, subject: str, message: str) -> None:
        self.findings.append(lost(subject, message, LABWEB))

    def _fresh(self, wanted: str) -> str:
        """Return a key that neither a node has nor another thing of the lab."""
        key = _free(wanted, self._taken)
        self._taken.add(key)
        return key

    def _check_amounts(self, key: str, said: Mapping[str, Any], kinds: Mapping[str, bool]) -> None:
        """Lose what stands where an amount is expected and is none."""
        for name, is_volume in kinds.items():
            value = said.get(name)
            is_said = value is not None and value != ""
            if is_said and (volume_nl(value) if is_volume else decimal(value)) is None:
                self._lose(key, f"{name} is {value!r}, which is no {_EXPECTED[is_volume]}")

    def _put(
        self,
        key: str,
        kind: str,
        parent: str = "",
        *,
        name: str = "",
        **config: Any,  # noqa: ANN401 - as a kind takes it
    ) -> dict[str, Any]:
        known = {one: value for one, value in config.items() if value is not None}
        entry: dict[str, Any] = {"key": key, "name": name or key, "kind": kind}
        entry |= {"parent": parent or self._bench, "config": known}
        self._resources[key] = entry
        return entry

    def _element(self, element: Element) -> None:
        key, equipment = element.key, self._equipment
        if element.role is ElementRole.VALVE:
            self._put(key, "rotary_valve", ports_count=_VALVE_PORTS, common_port=_COMMON)
        elif element.role is ElementRole.CARTRIDGE:
            self._put(key, "cartridge", filling=equipment.chemical(key) or None)
        elif element.role is ElementRole.PUMP:
            self._put(key, "syringe_pump", capacity_ul=_ul(element.capacity_nl))
        elif element.role is ElementRole.VACUUM:
            # Behind a line alone something draws that the graph does not show.
            is_led = is_passive(element) and equipment.vacuum_pump(key) is not None
            self._put(key, "vacuum_line" if is_led else "vacuum_controller")
        elif equipment.gas(key):
            self._put(key, "bottle", gas=equipment.gas(key))
        elif element.role is ElementRole.VESSEL:
            self._vessel(element)
        else:
            self._device(element)

    def _vessel(self, element: Element) -> None:
        key, equipment = element.key, self._equipment
        sort, parent = equipment.sort(key), self._bench
        if sort is VesselSort.ROTAVAP:
            parent = self._fresh(f"{key}_evaporator")
            self._put(parent, "rotary_evaporator", **_reach(equipment.thermostats(key)[0]))
            size = _ul(equipment.capacity_nl(f"{key}#{COLLECT}"))
            self._receivers[key] = self._fresh(f"{key}_receiver")
            self._put(self._receivers[key], "flask", capacity_ul=size)
        if sort not in _KINDS:
            self._lose(key, f"{LABWEB} has no {sort}: it is written as a vessel of no sort")
        capacity = _ul(equipment.capacity_nl(key))
        entry = self._put(key, _KINDS.get(sort, "vessel"), parent, capacity_ul=capacity)
        held = equipment.contents(key)
        if held:
            contents = [{"lot": self._lot(one, key), "amount_ul": _ul(nl)} for one, nl in held]
            entry["contents"] = contents
        elif equipment.chemical(key):
            what = equipment.chemical(key)
            self._lose(key, f"it is labelled {what} and holds nothing that is known: not held")

    def _lot(self, chemical: str, vessel: str) -> str:
        self._materials.setdefault(chemical, {"key": chemical, "name": chemical})
        key = _free(f"{vessel}/{chemical}", {lot["key"] for lot in self._lots})
        self._lots.append({"key": key, "material": chemical})
        return key

    def _device(self, element: Element) -> None:
        """Write what acts on vessels by the sorts that plans know it by."""
        key, equipment, vessels = element.key, self._equipment, self._equipment.vessels
        near = [one for one in equipment.near(key) if one in vessels]
        heats = [t for one in near for t in equipment.thermostats(one) if t.key == key]
        stirs = any(equipment.stirrer(one) == key for one in near)
        if heats:
            self._put(key, "heater_stirrer" if stirs else "thermostat", **_reach(heats[0]))
        elif stirs:
            self._put(key, "stirrer")
        else:
            self._put(key, "foreign")
            self._lose(key, f"{LABWEB} has no {element.kind}: it is kept and not planned with")
        self._lose(key, f"{LABWEB} does not hold the class {element.kind}: its driver says it")

    def _connections(self) -> list[dict[str, Any]]:
        found: dict[str, dict[str, Any]] = {}
        ends: dict[tuple[tuple[str, str], tuple[str, str]], str] = {}
        bad = {defect.subject for defect in self._rig.defects}
        self.findings += [lost(d.subject, d.message, LABWEB) for d in self._rig.defects]
        for tube in (tube for tube in self._rig.tubes if tube.key not in bad):
            self.findings += unheld(tube.key, tube.attributes, _SAID_OF_LINK, LABWEB)
            self._check_amounts(tube.key, tube.attributes, {"volume": True})
            medium, source, target = self._joined(tube)
            back = ends.get((target, source))
            if back is not None and found[back]["medium"] == medium.value:
                found[back]["is_two_way"] = True
                continue
            if (source, target) in ends:
                continue  # The same, drawn twice.
            key = _free("_".join((*source, target[0])), found)
            ends[source, target] = key
            found[key] = {
                "key": key,
                "source": {"resource": source[0], "port": source[1]},
                "target": {"resource": target[0], "port": target[1]},
                "medium": medium.value,
                "is_two_way": medium not in (Medium.LIQUID, Medium.GAS) or tube.is_two_way,
                "dead_volume_ul": _ul(tube.dead_volume_nl),
            }
        for flask, receiver in self._receivers.items():
            key = _free(f"{flask}_vapour", found)
            found[key] = {
                "key": key,
                "source": {"resource": flask, "port": "vapour"},
                "target": {"resource": receiver, "port": "condenser"},
                "medium": Medium.GAS.value,
                "is_two_way": False,
            }
        return list(found.values())

    def _joined(self, tube: Tube) -> tuple[Medium, tuple[str, str], tuple[str, str]]:
        """Return what a link carries, and its ends as a lab calls them."""
        medium, name = tube.medium, ""
        kinds = [self._resources[key]["kind"] for key in (tube.source, tube.target)]
        if not tube.source_port and not tube.target_port:
            medium, name = next((_MEDIA[k] for k in kinds if k in _MEDIA), (Medium.OTHER, "joint"))
        elif not VACUUMS.isdisjoint(kinds) or any(
            self._is_gas(k) for k in (tube.source, tube.target)
        ):
            medium = Medium.GAS
        ends = (
            (tube.source, tube.source_port, tube.target),
            (tube.target, tube.target_port, tube.source),
        )
        source, target = (self._end(key, port or name, far, medium) for key, port, far in ends)
        return medium, source, target

    def _is_gas(self, key: str) -> bool:
        return "gas" in self._resources[key]["config"]

    def _end(self, key: str, port: str, far: str, medium: Medium) -> tuple[str, str]:
        entry = self._resources[key]
        if port == COLLECT and key in self._receivers:
            return self._end(self._receivers[key], "0", far, medium)
        if entry["kind"] == "rotary_valve":
            return key, str(int(port) + 1) if port.isdigit() else port
        if entry["kind"] in ("flask", "waste", "reactor", "vessel") and medium is Medium.LIQUID:
            known = self._ports.setdefault(key, {})
            is_free = port and not port.isdigit() and port not in known.values()
            name = port if is_free else _free(f"tube_{len(known) + 1}", known.values())
            return key, known.setdefault(f"{far}/{port}", name)
        return key, port


def _reach(thermostat: RigThermostat) -> dict[str, Any]:
    ends = {"min_temperature_c": thermostat.low_c, "max_temperature_c": thermostat.high_c}
    return {name: float(value) for name, value in ends.items() if value is not None}


def _ul(nanolitres: int | None) -> float | None:
    return None if nanolitres is None else nanolitres / _NL_PER_UL


def _free(wanted: str, known: Container[str]) -> str:
    key, number = wanted, 2
    while key in known:
        key, number = f"{wanted}_{number}", number + 1
    return key
