"""The tubes of a lab file as they are, and by brute force what can flow through them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

SYRINGES = frozenset({"syringe_pump"})
VESSELS = frozenset(
    "well trough tube bottle flask vial vessel reactor separator waste".split()  # noqa: SIM905 - a list of words
)
"""Kinds that liquid stands in."""

BARE_PUMPS = frozenset({"drivers.connectors.chemputer_pump:ChemputerPump"})
"""Drivers of pumps that turn no valve."""

_MOST_STROKES = 500
_Port = tuple[str, str]


class Wrong(Exception):  # noqa: N818 - what a proof finds, not an error of ours
    """A plan does not do what it should."""


class Plumbing:
    """Resources and tubes by key, straight from the file."""

    def __init__(self, lab: Mapping[str, Any]) -> None:
        self.resources = {entry["key"]: entry for entry in lab["resources"]}
        self.devices = list(lab["devices"])
        self.tubes: dict[_Port, dict[_Port, set[str]]] = {}
        """Port → far port → ways that liquid may flow, seen from here: "out", "in"."""

        for tube in lab["connections"]:
            if tube["medium"] == "liquid":
                ends = [(tube[end]["resource"], tube[end]["port"]) for end in ("source", "target")]
                both = tube["is_two_way"]
                self._lay(ends[0], ends[1], {"out", "in"} if both else {"out"})
                self._lay(ends[1], ends[0], {"out", "in"} if both else {"in"})
        self._joined: dict[tuple[str, bool, frozenset[str]], set[str]] = {}
        self.driven = {self.valve_of(d) for d in self.devices if turns_valve(d)}

    def _lay(self, here: _Port, there: _Port, ways: set[str]) -> None:
        self.tubes.setdefault(here, {}).setdefault(there, set()).update(ways)

    def kind(self, key: str) -> str:
        return str(self.resources[key]["kind"])

    def of_kind(self, kind: str) -> list[str]:
        return [key for key in self.resources if self.kind(key) == kind]

    def vessels(self) -> list[str]:
        return sorted(key for key in self.resources if self.kind(key) in VESSELS)

    def common(self, valve: str) -> str:
        return str(self.resources[valve]["config"].get("common_port", "common"))

    def capacity_nl(self, key: str) -> Fraction | None:
        capacity_ul = self.resources[key]["config"].get("capacity_ul")
        return None if capacity_ul is None else Fraction(repr(capacity_ul)) * 1000

    def dead_nl(self, key: str) -> Fraction:
        return Fraction(repr(self.resources[key]["config"].get("dead_volume_ul", 0))) * 1000

    def held_nl(self, key: str) -> Fraction:
        contents = self.resources[key].get("contents", [])
        return sum((Fraction(repr(c["amount_ul"])) * 1000 for c in contents), Fraction(0))

    def pump_of(self, device: Mapping[str, Any]) -> str:
        nodes = device["nodes"]
        return str(nodes["pump"])

    def valve_of(self, device: Mapping[str, Any]) -> str:
        """Return what `select_port` of a device turns: its valve, or the pump's own."""
        nodes = device["nodes"]
        return str(nodes.get("valve") or nodes["pump"])

    def ports_count(self, device: Mapping[str, Any]) -> int:
        return int(device["config"].get("ports_count", 9))

    def pumps(self) -> list[dict[str, Any]]:
        return [device for device in self.devices if is_pump(device)]

    def far_end(
        self,
        pump: str,
        positions: Mapping[str, str | None],
        *,
        draws: bool,
        ends: frozenset[str] = VESSELS,
    ) -> str:
        """Return the vessel a syringe is joined to as the valves stand, or raise Wrong."""
        way = "in" if draws else "out"
        there = self._first(pump, positions, way)
        seen: set[_Port] = set()
        while True:
            if there in seen:
                raise Wrong(f"{pump} is joined to itself through {there}")
            seen.add(there)
            key, port = there
            if self.kind(key) in ends:
                return key
            if self.kind(key) != "rotary_valve":
                raise Wrong(f"liquid of {pump} meets {key}, a {self.kind(key)}")
            facing = {self.common(key): positions.get(key), positions.get(key): self.common(key)}
            leaves = facing.get(port)
            if leaves is None:
                raise Wrong(f"{key} stands at {positions.get(key)} and closes port {port}")
            self._across(there, "in" if way == "out" else "out")
            seen.add((key, leaves))
            there = self._across((key, leaves), way)

    def _first(self, pump: str, positions: Mapping[str, str | None], way: str) -> _Port:
        """Return where the one tube leads that a syringe's liquid can take."""
        mine = [port for port in self.tubes if port[0] == pump]
        if pump in self.driven and all(port.isdigit() for _, port in mine):
            return self._across((pump, positions.get(pump) or ""), way)
        able = [there for port in mine for there, ways in self.tubes[port].items() if way in ways]
        if len(able) != 1:
            raise Wrong(f"{pump} has {len(able)} ways {way}")
        return able[0]

    def _across(self, here: _Port, way: str) -> _Port:
        """Return the far end of the one tube at a port."""
        far = self.tubes.get(here, {})
        if len(far) != 1:
            raise Wrong(f"{len(far)} tubes are at {here}")
        ((there, ways),) = far.items()
        if way not in ways:
            raise Wrong(f"a check valve closes the way {way} at {here}")
        return there

    def joined(
        self, device: Mapping[str, Any], *, draws: bool, ends: frozenset[str] = VESSELS
    ) -> set[str]:
        """Return every vessel a pump can draw from, or push into, by trying all positions."""
        pump = self.pump_of(device)
        found = self._joined.get((pump, draws, ends))
        if found is None:
            found = self._joined[pump, draws, ends] = set()
            for positions in self._settings(pump):
                try:
                    found.add(self.far_end(pump, positions, draws=draws, ends=ends))
                except Wrong:
                    continue
        return found

    def is_chained(self, source: str, target: str) -> bool:
        """Say whether syringes can pass liquid on from one vessel to another."""
        pumps = {self.pump_of(device): device for device in self.pumps()}
        todo = [p for p, device in pumps.items() if source in self.joined(device, draws=True)]
        seen: set[str] = set()
        while todo:
            pump = todo.pop()
            if pump in seen or pump not in pumps:
                continue
            seen.add(pump)
            if target in self.joined(pumps[pump], draws=False):
                return True
            onward = self.joined(pumps[pump], draws=False, ends=SYRINGES)
            todo += [
                other
                for other in onward & pumps.keys()
                if pump in self.joined(pumps[other], draws=True, ends=SYRINGES)
            ]
        return False

    def _settings(self, pump: str) -> Iterator[dict[str, str | None]]:
        """Yield every setting of the driven valves that a syringe might be joined through."""
        near = [valve for valve in sorted(self._around(pump)) if valve in self.driven]
        counts = {self.valve_of(device): self.ports_count(device) for device in self.devices
                  if is_pump(device) or is_valve(device)}  # fmt: skip
        yield from self._each(near, counts, {})

    def _each(
        self, valves: list[str], counts: Mapping[str, int], made: dict[str, str | None]
    ) -> Iterator[dict[str, str | None]]:
        if not valves:
            yield dict(made)
            return
        numbers = [str(number) for number in range(1, counts[valves[0]] + 1)]
        used: list[str | None] = [n for n in numbers if (valves[0], n) in self.tubes]
        for number in used or [None]:
            yield from self._each(valves[1:], counts, {**made, valves[0]: number})

    def _around(self, pump: str) -> set[str]:
        """Return the pump and the valves that hang together with it by tubes."""
        seen, todo = set(), [pump]
        while todo:
            key = todo.pop()
            if key in seen:
                continue
            seen.add(key)
            if key == pump or self.kind(key) == "rotary_valve":
                far = [
                    end[0] for port, ends in self.tubes.items() if port[0] == key for end in ends
                ]
                todo += [k for k in far if self.kind(k) == "rotary_valve"]
        return seen

    def reasons(self, source: str, target: str, amount_nl: int) -> set[str]:
        """Return why a transfer cannot be done now; nothing means that it can."""
        found = set()
        if source == target:
            return {"same"}
        if self.held_nl(source) - self.dead_nl(source) < amount_nl:
            found.add("crutd.insufficient_volume")
        capacity = self.capacity_nl(target)
        if capacity is None:
            found.add("crutd.unknown_capacity")
        elif self.held_nl(target) + amount_nl > capacity:
            found.add("crutd.capacity_exceeded")
        return found | self._route_reasons(source, target, amount_nl)

    def _route_reasons(self, source: str, target: str, amount_nl: int) -> set[str]:
        drawing = [d for d in self.pumps() if source in self.joined(d, draws=True)]
        pushing = [d for d in self.pumps() if target in self.joined(d, draws=False)]
        able = [device for device in drawing if device in pushing]
        if not able and self.is_chained(source, target):
            return set()
        if not able:
            return {"plan.needs_relay" if drawing and pushing else "plan.no_route"}
        small = [d for d in able if amount_nl > _MOST_STROKES * self._syringe_nl(d)]
        return {"plan.too_many_strokes"} if len(small) == len(able) else set()

    def _syringe_nl(self, device: Mapping[str, Any]) -> Fraction:
        return self.capacity_nl(self.pump_of(device)) or Fraction(0)


def is_pump(device: Mapping[str, Any]) -> bool:
    return "pump" in device["nodes"]


def turns_valve(device: Mapping[str, Any]) -> bool:
    return is_valve(device) or (is_pump(device) and device["driver"] not in BARE_PUMPS)


def is_valve(device: Mapping[str, Any]) -> bool:
    return "valve" in device["nodes"]
