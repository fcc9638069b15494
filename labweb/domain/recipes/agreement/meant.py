"""The steps of a workflow as deeds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from labweb.domain.recipes.agreement import deeds
from labweb.domain.recipes.agreement.deeds import Deed, DeedStanding, DeedWay, Place
from labweb.domain.units import parse, parse_mass_ug, parse_volume_nl
from labweb.domain.workflows.unit_operations.step_palette import called
from labweb.domain.workflows.unit_operations.unit_operation import ALL

_KPA_TO_MBAR = 10
_REACT = "react"

Params = Mapping[str, Any]


def deeds_of_workflow(document: Mapping[str, Any]) -> Iterator[Deed]:
    """Read the steps of a workflow as deeds; `react` changes lots and moves nothing."""
    standing = DeedStanding()
    for step in document["steps"]:
        kind, place = step["kind"], {"step": step["id"]}
        if kind in _STEPS:
            yield from _STEPS[kind](step["params"], standing, place)
        elif kind != _REACT:
            yield Deed((kind, step["id"]), f"do {called(step, {})}", place)
    yield deeds.end(standing)


def _transfer(params: Params, standing: DeedStanding, place: Place) -> Iterator[Deed]:
    amount = ALL if params["volume"] == ALL else parse_volume_nl(params["volume"])
    rates = (parse(params["flow_rate"], "flow_rate"),) if "flow_rate" in params else ()
    way = DeedWay(_key(params["source"]), _key(params["target"]), _through(params))
    yield deeds.move(way, amount, standing, place, rates, _pumps(params))


def _start_stir(params: Params, standing: DeedStanding, _place: Place) -> Iterator[Deed]:
    standing.stirred[_key(params["vessel"])] = parse(params["stir_speed"], "speed")
    yield from ()


def _stop_stir(params: Params, standing: DeedStanding, _place: Place) -> Iterator[Deed]:
    standing.stirred.pop(_key(params["vessel"]), None)
    yield from ()


def _stop_both(params: Params, standing: DeedStanding, place: Place) -> Iterator[Deed]:
    standing.heated.pop(_key(params["vessel"]), None)
    yield from _stop_stir(params, standing, place)


def _stop_heat(params: Params, standing: DeedStanding, _place: Place) -> Iterator[Deed]:
    standing.heated.pop(_key(params["vessel"]), None)
    yield from ()


def _stir(params: Params, standing: DeedStanding, place: Place) -> Iterator[Deed]:
    yield from _start_stir(params, standing, place)
    yield deeds.wait(parse(params["duration"], "time"), standing, place)
    yield from _stop_stir(params, standing, place)


def _heat_chill(params: Params, standing: DeedStanding, place: Place) -> Iterator[Deed]:
    vessel = _key(params["vessel"])
    is_stirred = "stir_speed" in params
    if is_stirred:
        yield from _start_stir(params, standing, place)
    standing.heated[vessel] = parse(params["temperature"], "temperature")
    if "hold_for" in params:
        yield deeds.wait(parse(params["hold_for"], "time"), standing, place)
        standing.heated.pop(vessel)
        yield from _stop_stir(params, standing, place) if is_stirred else ()


def _await(_params: Params, _standing: DeedStanding, _place: Place) -> Iterator[Deed]:
    yield from ()


def _wait(params: Params, standing: DeedStanding, place: Place) -> Iterator[Deed]:
    yield deeds.wait(parse(params["duration"], "time"), standing, place)


def _separate(params: Params, standing: DeedStanding, place: Place) -> Iterator[Deed]:
    yield deeds.wait(parse(params["settle_for"], "time"), standing, place)
    way = DeedWay(_key(params["vessel"]), _key(params["target"]), _through(params))
    yield deeds.lower(way, standing, place, _pumps(params))


def _filter(params: Params, standing: DeedStanding, place: Place) -> Iterator[Deed]:
    way = DeedWay(_key(params["vessel"]), _key(params["target"]))
    yield deeds.filtrate(way, standing, place, _pumps(params))


def _dry(params: Params, standing: DeedStanding, place: Place) -> Iterator[Deed]:
    vessel = _key(params["vessel"])
    yield deeds.vacuum(vessel, _mbar(params), place)
    yield deeds.wait(parse(params["duration"], "time"), standing, place)
    yield deeds.vent(vessel, "", place)


def _evaporate(params: Params, _standing: DeedStanding, place: Place) -> Iterator[Deed]:
    said = {
        "s": parse(params["duration"], "time"),
        "mbar": _mbar(params),
        "c": parse(params["temperature"], "temperature"),
        "rpm": parse(params["speed"], "speed"),
    }
    yield deeds.boil(_key(params["vessel"]), said, place)


def _evacuate_refill(params: Params, standing: DeedStanding, place: Place) -> Iterator[Deed]:
    vessel = _key(params["vessel"])
    for _ in range(int(params["rounds"])):
        yield deeds.vacuum(vessel, _mbar(params), place)
        if "vacuum_for" in params:
            yield deeds.wait(parse(params["vacuum_for"], "time"), standing, place)
        yield deeds.vent(vessel, _key(params["gas"]), place)
        if "gas_for" in params:
            yield deeds.wait(parse(params["gas_for"], "time"), standing, place)


def _confirm(params: Params, _standing: DeedStanding, place: Place) -> Iterator[Deed]:
    yield deeds.ask(params["question"], place)


def _add_solid(params: Params, _standing: DeedStanding, place: Place) -> Iterator[Deed]:
    yield deeds.weigh_in(_key(params["target"]), parse_mass_ug(params["mass"]), place)


def _push_gas(params: Params, _standing: DeedStanding, place: Place) -> Iterator[Deed]:
    way = DeedWay(_key(params["gas"]), _key(params["target"]))
    yield deeds.push(way, parse_volume_nl(params["volume"]), place, _pumps(params))


_STEPS: Mapping[str, Callable[[Params, DeedStanding, Place], Iterator[Deed]]] = {
    "transfer": _transfer,
    "start_stir": _start_stir,
    "stop_stir": _stop_stir,
    "stop_heat": _stop_heat,
    "stop_heat_stir": _stop_both,
    "stir": _stir,
    "heat_chill": _heat_chill,
    "await_temperature": _await,
    "wait": _wait,
    "separate": _separate,
    "filter": _filter,
    "dry": _dry,
    "evaporate": _evaporate,
    "evacuate_refill": _evacuate_refill,
    "push_gas": _push_gas,
    "confirm": _confirm,
    "add_solid": _add_solid,
}

SAID = frozenset(_STEPS)
"""Kinds of steps that are read as deeds by their values."""


def _mbar(params: Params) -> float:
    return round(parse(params["pressure"], "pressure") * _KPA_TO_MBAR, 6)


def _through(params: Params) -> tuple[str, ...]:
    return (_key(params["through"]),) if "through" in params else ()


def _pumps(params: Params) -> tuple[str, ...]:
    return (_key(params["pump"]),) if "pump" in params else ()


def _key(reference: str) -> str:
    return reference.removeprefix("@")
