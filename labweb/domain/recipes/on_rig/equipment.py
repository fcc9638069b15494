"""What a rig offers at each vessel, by class and type of its nodes and never by their names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from enum import StrEnum
from functools import cached_property
from itertools import product
from typing import Any

from labweb.domain.graph.elements import NL_PER_UL, Element, ElementRole
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.rig.nodes_as_elements import decimal, volume_nl
from labweb.domain.graph.rig.rig_model import Rig, RigFormat
from labweb.domain.graph.rig.stated_volumes import level_nl, listed_nl

COLLECT = "collect"
"""Port of a rotary evaporator that its collecting flask is drawn from."""

CARRIES = frozenset({Medium.LIQUID, Medium.VACUUM, Medium.GAS})
"""What tubes carry; all else joins devices to what they act on."""


class VesselSort(StrEnum):
    """What a vessel is for."""

    REACTOR = "reactor"
    FILTER = "filter"
    SEPARATOR = "separator"
    ROTAVAP = "rotavap"
    CENTRIFUGE = "centrifuge"
    WASTE = "waste"
    FLASK = "flask"
    PLAIN = "vessel"
    """A vessel whose class says no more than that it is one."""


_SORTS = (
    (r"rotavap|rotovap|rv_?10|r300", VesselSort.ROTAVAP),
    (r"centrifuge", VesselSort.CENTRIFUGE),
    (r"waste", VesselSort.WASTE),
    (r"separator", VesselSort.SEPARATOR),
    (r"filter", VesselSort.FILTER),
    (r"reactor", VesselSort.REACTOR),
    (r"flask|bottle|vial", VesselSort.FLASK),
)
_STIRS = re.compile(
    r"heitorque|rzr_?2052|microstar|stirrer|hot_?plate|rct|ret_?control|ret_?visc|heater_?stirrer"
)
_HEATS = re.compile(
    r"hot_?plate|rct|ret_?control|ret_?visc|heat|julabo|cf41|huber|chill|cool|cryo|thermostat"
)
_LIGHTS = re.compile(r"lamp|light|led")
_CONDUCTS = re.compile(r"conductivity")
_EVAPORATES = re.compile(r"rotary_?evaporator")
_PNEUMATIC = re.compile(r"pneumatic")
_SENSE = "sensor|meter|probe|transmitter|electrode"
_SENSES = re.compile(r"sensor|camera|meter$|probe|transmitter|balance")
_CAMEL = re.compile(r"(?<=[a-z]{2})(?=[A-Z])")
"""Where a class that is written in camel case begins a word."""

_RANGES_C = (
    (re.compile(r"julabo|cf41|huber"), (Decimal(-40), Decimal(100))),
    (re.compile(r"rv_?10"), (Decimal(18), Decimal(180))),
    (re.compile(r"rct|ret_?control|ret_?visc"), (Decimal(18), Decimal(360))),
)
"""What a class reaches when its node does not say.

Source:
    Limits that the published XDL compiler checks for these classes."""

_ONLY_HEATS = re.compile(r"^(?!.*(chill|cool|cryo)).*(heat|hot_?plate)")
_HEATED_C = Decimal(18)
"""What is colder is not reached by what only heats.

Source:
    Lower limit of hotplates that the published XDL compiler checks."""

GASES: Mapping[str, str] = {
    "nitrogen": "nitrogen",
    "n2": "nitrogen",
    "argon": "argon",
    "ar": "argon",
    "air": "air",
    "hydrogen": "hydrogen",
    "h2": "hydrogen",
}
_NO_CHEMICAL = frozenset({"none", "None"})
"""What graphs write at a flask for nothing."""

INERT = frozenset({"nitrogen", "argon"})


@dataclass(frozen=True, slots=True)
class RigThermostat:
    """A heater or chiller at a vessel, and what it reaches; None: nobody says."""

    key: str
    low_c: Decimal | None
    high_c: Decimal | None
    only_heats: bool = False

    def covers(self, temperature_c: Decimal) -> bool:
        """Tell whether it surely reaches a temperature."""
        if self.low_c is None or self.high_c is None:
            return False
        return self.low_c <= temperature_c <= self.high_c

    def is_beyond(self, temperature_c: Decimal) -> bool:
        """Tell whether it surely does not reach a temperature."""
        low_c = _HEATED_C if self.low_c is None and self.only_heats else self.low_c
        is_below = low_c is not None and temperature_c < low_c
        return is_below or (self.high_c is not None and temperature_c > self.high_c)

    def __str__(self) -> str:
        low, high = ("?" if end is None else f"{end}" for end in (self.low_c, self.high_c))
        only = ", which only heats" if self.only_heats and self.low_c is None else ""
        return f"{self.key} from {low} to {high} °C{only}"


class Equipment:
    """A rig as the passes ask about it."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.elements = {element.key: element for element in rig.elements}
        self._near: dict[str, list[str]] = {key: [] for key in self.elements}
        for tube in rig.tubes:
            self._join(tube.source, tube.target)
        for element in rig.elements:
            carrier = self.elements.get(str(element.attributes.get("parent")))
            if carrier is not None:
                self._join(element.key, carrier.key)

    def _join(self, one: str, other: str) -> None:
        self._near[one].append(other)
        self._near[other].append(one)

    def near(self, key: str) -> list[str]:
        """Return what a link of any sort joins an element to, and what it stands on, by id."""
        return sorted(set(self._near.get(key, ())))

    @cached_property
    def vessels(self) -> dict[str, VesselSort]:
        """Return the vessels with what each is for; sources of gas are none."""
        return {
            key: VesselSort.ROTAVAP if self._turning(key) else _sort(element)
            for key, element in sorted(self.elements.items())
            if element.role is ElementRole.VESSEL and self.gas(key) == ""
        }

    def _turning(self, key: str) -> str | None:
        """Return the rotary evaporator that a flask stands on as a part of its own."""
        carrier = self.elements.get(str(self.elements[key].attributes.get("parent")))
        return carrier.key if carrier is not None and _is(carrier, _EVAPORATES) else None

    def evaporator(self, key: str) -> str:
        """Return what turns, warms and lowers a flask: the vessel itself, or what it stands on."""
        return self._turning(key) or key

    def collecting(self, key: str) -> str | None:
        """Return where the vapour of a flask condenses; None: no way leads there."""
        if self._turning(key) is None:
            return f"{key}#{COLLECT}"
        return self._receivers.get(key)

    @cached_property
    def _receivers(self) -> dict[str, str]:
        """Return the flask that vapour runs into, by the flask that turns on an evaporator."""
        return {
            tube.source: tube.target
            for tube in sorted(self.rig.tubes, key=lambda tube: tube.key, reverse=True)
            if tube.medium is Medium.GAS
            and self.elements[tube.source].role is ElementRole.VESSEL
            and self._turning(tube.source)
            and tube.target in self.vessels
        }

    def is_receiver(self, key: str) -> bool:
        """Tell whether vapour condenses in a vessel: it is no spare flask."""
        return key in self._receivers.values()

    def shares_vacuum(self, key: str) -> list[str]:
        """Return the vessels whose vacuum is on a vessel: itself, and the flask it receives of."""
        owner = key.partition("#")[0]
        return [owner, *(flask for flask, end in self._receivers.items() if end == owner)]

    @cached_property
    def ways(self) -> dict[str, list[tuple[str, str, str]]]:
        """Return the tubes for liquid, gas and vacuum of each element: port, far end, its port.

        A link to a vacuum is one for vacuum, but in a lab of ours, which says what each carries.
        """
        is_said = self.rig.format is RigFormat.LABWEB
        found: dict[str, set[tuple[str, str, str]]] = {}
        for tube in self.rig.tubes:
            ends = (self.elements[tube.source], self.elements[tube.target])
            is_gas = any(end.role in (ElementRole.GAS, ElementRole.VACUUM) for end in ends)
            is_vacuum = not is_said and any(end.role is ElementRole.VACUUM for end in ends)
            wanted = CARRIES - {Medium.LIQUID} if is_said and is_gas else CARRIES
            if tube.medium in wanted or is_vacuum:
                there = (tube.source_port, tube.target, tube.target_port)
                back = (tube.target_port, tube.source, tube.source_port)
                found.setdefault(tube.source, set()).add(there)
                found.setdefault(tube.target, set()).add(back)
        return {key: sorted(ways) for key, ways in found.items()}

    @cached_property
    def cartridges(self) -> dict[str, str]:
        """Return cartridges and columns with their filling."""
        return {
            key: self.chemical(key)
            for key, element in sorted(self.elements.items())
            if element.role is ElementRole.CARTRIDGE
        }

    def sort(self, key: str) -> VesselSort:
        """Return what a vessel is for."""
        return self.vessels.get(key, VesselSort.PLAIN)

    def chemical(self, key: str) -> str:
        """Return the substance that the graph names at a node."""
        for place in places(self.elements[key]):
            value = place.get("chemical")
            if isinstance(value, str) and value.strip():
                return "" if value.strip() in _NO_CHEMICAL else value.strip()
        return ""

    def gas(self, key: str) -> str:
        """Return which gas an element gives, "" when it gives none."""
        element = self.elements[key]
        if element.role is ElementRole.GAS:
            found = next((p["gas_type"] for p in places(element) if p.get("gas_type")), "")
            return GASES.get(str(found).strip().lower(), str(found))
        if element.role is ElementRole.VESSEL and "flask" in element.kind.lower():
            return GASES.get(self.chemical(key).lower(), "")
        return ""

    def capacity_nl(self, key: str) -> int | None:
        """Return how much a vessel holds; None: nobody says."""
        owner, _, part = key.partition("#")
        element = self.elements[owner]
        return size_nl(element, "collection_flask_volume") if part else size_nl(element)

    def contents(self, key: str) -> list[tuple[str, int]]:
        """Return what the graph says is in a vessel: names and nanolitres."""
        element = self.elements[key]
        level, listed = level_nl(element), listed_nl(element)
        if level and (self.chemical(key) or not listed):
            return [(self.chemical(key) or f"contents of {key}", level)]
        return listed

    def stirrer(self, key: str) -> str | None:
        """Return what stirs a vessel."""
        return next((near for near in self.near(key) if _is(self.elements[near], _STIRS)), None)

    def thermostats(self, key: str) -> list[RigThermostat]:
        """Return what heats or chills a vessel; a rotary evaporator has its own bath."""
        if self.sort(key) is VesselSort.ROTAVAP:
            return [_thermostat(self.elements[self.evaporator(key)])]
        return [
            _thermostat(self.elements[near])
            for near in self.near(key)
            if _is(self.elements[near], _HEATS)
        ]

    def speeds(self, key: str) -> tuple[Decimal | None, Decimal | None]:
        """Return the least and most speed that a device's settings say."""
        low, high = (_numbers(self.elements[key], f"{end}_speed_rpm") for end in ("min", "max"))
        return next(low, None), next(high, None)

    def devices(self, key: str, pattern: re.Pattern[str]) -> list[str]:
        """Return the devices of a class that a link joins to a vessel."""
        return [near for near in self.near(key) if _is(self.elements[near], pattern)]

    def device(self, key: str, pattern: re.Pattern[str]) -> str | None:
        """Return the device of a class at a vessel: the vessel itself, or one that is joined."""
        if pattern.search(self.elements[key].kind.lower()):
            return key
        return next(iter(self.devices(key, pattern)), None)

    def conductivity(self, key: str) -> str | None:
        """Return the conductivity sensor of a separator."""
        return next((near for near in self.near(key) if _is(self.elements[near], _CONDUCTS)), None)

    def lamp(self, key: str) -> str | None:
        """Return what lights a vessel."""
        return next((near for near in self.near(key) if _is(self.elements[near], _LIGHTS)), None)

    def sensor(self, key: str, quantity: str) -> str | None:
        """Return the sensor of a quantity at a vessel."""
        wanted = re.compile(rf"(?<![a-z]){re.escape(quantity.lower())}(?={_SENSE}|[^a-z]|$)")
        for near in self.near(key):
            element = self.elements[near]
            words = _CAMEL.sub(" ", element.kind).lower()
            if _is(element, _SENSES) and wanted.search(words):
                return near
        return None

    def pneumatic(self, key: str) -> tuple[str, str] | None:
        """Return the pneumatic controller of a vessel, and the port of it."""
        for tube in sorted(self.rig.tubes, key=lambda tube: tube.key):
            for own, far, port in (
                (tube.source, tube.target, tube.target_port),
                (tube.target, tube.source, tube.source_port),
            ):
                if own == key and _is(self.elements[far], _PNEUMATIC):
                    return far, port
        return None

    def vacuum_pump(self, line: str) -> str | None:
        """Return the pump of a vacuum line; the line itself when it is one."""
        if is_passive(self.elements[line]):
            near = (self.elements[key] for key in self.near(line))
            return next(
                (e.key for e in near if e.role is ElementRole.VACUUM and not is_passive(e)), None
            )
        return line

    def drains(self, key: str) -> bool:
        """Tell whether the collecting flask of a rotary evaporator has a tube."""
        receiver = self._receivers.get(key)
        return any(
            (own == receiver and tube.medium is Medium.LIQUID) or (own, port) == (key, COLLECT)
            for tube in self.rig.tubes
            for own, port in ((tube.source, tube.source_port), (tube.target, tube.target_port))
        )


def _sort(element: Element) -> VesselSort:
    words = (element.kind, str(element.attributes.get("type") or ""))
    for word in words:
        for pattern, sort in _SORTS:
            if re.search(pattern, word.lower()):
                return sort
    return VesselSort.PLAIN


def _is(element: Element, pattern: re.Pattern[str]) -> bool:
    return element.role in (ElementRole.OTHER, ElementRole.VACUUM) and bool(
        pattern.search(element.kind.lower())
    )


def is_passive(element: Element) -> bool:
    """Tell whether a vacuum is a line, with its pump, if it has one, joined to it."""
    return element.kind.lower().replace("_", "") in ("chemputervacuum", "vacuum", "vacuumline")


def places(element: Element) -> Iterator[Mapping[str, Any]]:
    """Yield the objects of a node in which a graph may say something of it."""
    yield element.attributes
    for name in ("config", "data"):
        found = element.attributes.get(name)
        if isinstance(found, Mapping):
            yield found


def size_nl(element: Element, name: str = "max_volume") -> int | None:
    """Return how much a graph says that an element holds; None: it does not say."""
    for place in places(element):
        found = volume_nl(place.get(name), element.nl_per_unit)
        if found is None and name == "max_volume":
            found = volume_nl(place.get("capacity_ul"), NL_PER_UL)
        if found:
            return found
    return None


def _thermostat(element: Element) -> RigThermostat:
    low = next(_numbers(element, "min_temp", "min_temperature_c"), None)
    high = next(_numbers(element, "max_temp", "max_temperature_c"), None)
    usual = next((r for p, r in _RANGES_C if p.search(element.kind.lower())), (None, None))
    return RigThermostat(
        element.key,
        usual[0] if low is None else low,
        usual[1] if high is None else high,
        only_heats=bool(_ONLY_HEATS.search(element.kind.lower())),
    )


def _numbers(element: Element, *names: str) -> Iterator[Decimal]:
    for place, name in product(places(element), names):
        found = decimal(place.get(name))
        if found is not None:
            yield found
