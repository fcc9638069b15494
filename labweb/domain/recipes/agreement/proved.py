"""The claims of a plan, which is what is proved of it, as deeds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from decimal import Decimal
from typing import Any

from labweb.domain.recipes.agreement import deeds
from labweb.domain.recipes.agreement.deeds import (
    PRIME,
    PUSH,
    RINSE,
    WAIT,
    Deed,
    DeedStanding,
    DeedWay,
    Place,
)
from labweb.domain.workflows.unit_operations.unit_operation import ALL

_SILENT = frozenset({"fill", "empty", "reach", "gas", "stop_gas", "lower", "raise"})
"""Claims that a workflow does not have to say: by hand, or part of what it says at once."""

_PREPARE = "Prepare"

Claim = Mapping[str, Any]


def deeds_of_plan(plan: Mapping[str, Any]) -> list[Deed]:
    """Read the claims of a plan as deeds, in their order.

    A rinse, or the filling of a tube, that stands behind waits is read in front of them: it touches
    none of the vessels that wait, which stand just as long.
    """
    found: list[Deed] = []
    for deed in _claimed(plan):
        place = len(found)
        while deed.added in (RINSE, PRIME) and place and found[place - 1].what[0] == WAIT:
            place -= 1
        found.insert(place, deed)
    return found


def _claimed(plan: Mapping[str, Any]) -> Iterator[Deed]:
    reading = _Reading()
    for step in plan["steps"]:
        does, of = step["does"], step["of"]
        if of["operation"] == _PREPARE or does["kind"] in _SILENT:
            continue
        place = {name: of[name] for name in ("line", "column") if name in of}
        yield from reading.read(does, step["actions"], place)
    yield deeds.end(reading.standing)


def sources_of(plan: Mapping[str, Any]) -> dict[str, str]:
    """Return the vessels that a plan draws one reagent from: vessel → reagent of the recipe."""
    claims = (step["does"] for step in plan["steps"])
    return {does["from"]: does["lot"] for does in claims if "lot" in does and "from" in does}


def vessels_of(plan: Mapping[str, Any]) -> list[str]:
    """Return the other vessels that a plan binds: what it works in and pours into."""
    return sorted(set(plan["bindings"]["vessels"].values()) - sources_of(plan).keys())


class _Reading:
    """Follows what is stirred, heated and turned."""

    def __init__(self) -> None:
        self.standing = DeedStanding()
        self._turning: dict[str, dict[str, float | None]] = {}
        """Flask on a rotary evaporator → what was set of it."""

    def read(self, does: Claim, actions: Iterable[Any], place: Place) -> Iterable[Deed]:
        """Return the deeds of one claim."""
        if does["kind"] == "transfer":
            way = DeedWay(does["from"], does["to"], tuple(does.get("through", ())))
            amount = ALL if does.get("all") else _nl(does["volume_ul"])
            rates, pumps = _pushed(actions), _pumps(actions)
            return [deeds.move(way, amount, self.standing, place, rates, pumps)]
        if does["kind"] in _CHANGES:
            _CHANGES[does["kind"]](self, does)
            return []
        if does["kind"] in _DEEDS:
            made = _DEEDS[does["kind"]](self, does, place)
            return [replace(deed, pumps=_pumps(actions)) for deed in made]
        if does["kind"] in _ADDED:
            return [self._added(does, actions, place)]
        named = [f"{name} {value}" for name, value in does.items() if name != "kind"]
        return [Deed((does["kind"], *named), f"{does['kind']} {', '.join(named)}", place)]

    def _added(self, does: Claim, actions: Iterable[Any], place: Place) -> Deed:
        """Return what the plan does beside the recipe: what cleans, fills and empties tubes."""
        why, what = _ADDED[does["kind"]]
        way, much, pumps = (
            DeedWay(does["from"], does["to"]),
            _nl(does["volume_ul"]),
            _pumps(actions),
        )
        if why == PUSH:
            return replace(deeds.push(way, much, place, pumps), added=why)
        moved = deeds.move(way, much, self.standing, place, pumps=pumps)
        return replace(moved, text=f"{what} {does['lot']}: {moved.text}", added=why)

    def stir(self, does: Claim) -> None:
        self.standing.stirred[does["vessel"]] = does["speed_rpm"]

    def stop_stir(self, does: Claim) -> None:
        self.standing.stirred.pop(does["vessel"], None)

    def heat(self, does: Claim) -> None:
        if does["vessel"] in self._turning:
            self._turning[does["vessel"]]["c"] = does["temperature_c"]
        else:
            self.standing.heated[does["vessel"]] = does["temperature_c"]

    def stop_heat(self, does: Claim) -> None:
        self.standing.heated.pop(does["vessel"], None)

    def rotate(self, does: Claim) -> None:
        self._turning[does["vessel"]] = {"rpm": does["speed_rpm"]}

    def stop_rotate(self, does: Claim) -> None:
        self._turning.pop(does["vessel"], None)

    def vacuum(self, does: Claim, place: Place) -> list[Deed]:
        vessel, mbar = does["vessel"], does.get("pressure_mbar")
        if vessel in self._turning:
            self._turning[vessel]["mbar"] = mbar
            return []
        return [deeds.vacuum(vessel, mbar, place)]

    def vent(self, does: Claim, place: Place) -> list[Deed]:
        if does["vessel"] in self._turning:
            return []
        return [deeds.vent(does["vessel"], does.get("gas", ""), place)]

    def evaporate(self, does: Claim, place: Place) -> list[Deed]:
        said = self._turning.get(does["vessel"], {}) | {
            "s": does.get("duration_s", does.get("most_s"))
        }
        return [deeds.boil(does["vessel"], said, place)]

    def filter(self, does: Claim, place: Place) -> list[Deed]:
        return [deeds.filtrate(DeedWay(does["vessel"], does["to"]), self.standing, place)]

    def ask(self, does: Claim, place: Place) -> list[Deed]:
        return [deeds.ask(does["text"], place)]

    def add_solid(self, does: Claim, place: Place) -> list[Deed]:
        return [deeds.weigh_in(does["to"], does["mass_ug"], place)]

    def wait(self, does: Claim, place: Place) -> list[Deed]:
        return [deeds.wait(does["duration_s"], self.standing, place)]

    def separate(self, does: Claim, place: Place) -> list[Deed]:
        vessel, upper = does["vessel"], does["upper_to"]
        below = DeedWay(vessel, does["lower_to"], tuple(does.get("lower_through", ())))
        above = DeedWay(vessel, upper, tuple(does.get("upper_through", ())))
        lower = deeds.lower(below, self.standing, place)
        stays = upper == vessel
        return [lower] if stays else [lower, deeds.move(above, ALL, self.standing, place)]


_ADDED: Mapping[str, tuple[str, str]] = {
    "clean": (RINSE, "rinse the lines with"),
    "prime": (PRIME, "fill the tube of"),
    "push": (PUSH, ""),
}
_CHANGES: Mapping[str, Callable[[_Reading, Claim], None]] = {
    "stir": _Reading.stir,
    "stop_stir": _Reading.stop_stir,
    "heat": _Reading.heat,
    "stop_heat": _Reading.stop_heat,
    "rotate": _Reading.rotate,
    "stop_rotate": _Reading.stop_rotate,
}
_DEEDS: Mapping[str, Callable[[_Reading, Claim, Place], list[Deed]]] = {
    "vacuum": _Reading.vacuum,
    "vent": _Reading.vent,
    "evaporate": _Reading.evaporate,
    "filter": _Reading.filter,
    "wait": _Reading.wait,
    "ask": _Reading.ask,
    "add_solid": _Reading.add_solid,
    "separate": _Reading.separate,
}


def _pushed(groups: Iterable[Iterable[Mapping[str, Any]]]) -> tuple[float, ...]:
    """Return at which rates the last syringe on the way pushes into the vessel, µL/s."""
    pushing = [one for group in groups for one in group if one["action"] == "dispense"]
    last = pushing[-1]["device"] if pushing else ""
    return tuple(
        sorted({one["parameters"]["rate_ul_s"] for one in pushing if one["device"] == last})
    )


def _pumps(groups: Iterable[Iterable[Mapping[str, Any]]]) -> tuple[str, ...]:
    """Return whose syringes push, by their names."""
    pushing = (one for group in groups for one in group if one["action"] == "dispense")
    return tuple(sorted({one["device"] for one in pushing}))


def _nl(microlitres: float) -> int:
    return round(Decimal(str(microlitres)) * 1000)
