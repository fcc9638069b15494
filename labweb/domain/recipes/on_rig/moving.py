"""Liquid from vessel to vessel: the route, the strokes, flasks refilled, room looked after."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from typing import Any

from labweb.domain.graph.elements import ElementRole
from labweb.domain.recipes.on_rig.equipment import VesselSort
from labweb.domain.recipes.on_rig.making import BY_HAND, Making, say, used_parts
from labweb.domain.recipes.on_rig.matter import Portion, exactly, micro
from labweb.domain.recipes.on_rig.meetings import most_of
from labweb.domain.recipes.on_rig.wastes import look_at_meeting
from labweb.domain.recipes.on_rig.ways import RigMove, route
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace
from labweb.domain.units import render_volume
from labweb.domain.workflows.passes.liquids.stroke_pipeline import DeviceCommand, Group

NL_PER_ML = 1_000_000
GRAINS = NL_PER_ML
"""Nanolitres in a mL, and micrograms in a g."""

MOST_GRAINS = 10**12
"""Nothing in a laboratory is larger than 1000 L, or weighs as much as 1 t."""

MOST_PARTS = 500
"""Most times that a person empties a waste for one move."""


def conductors(making: Making, name: str, place: FilePlace) -> tuple[str, ...] | None:
    """Return the cartridge that is meant: by its id, or by its filling; None is told."""
    if not name:
        return ()
    known = making.equipment.cartridges
    element = making.equipment.elements.get(name)
    if name in known or (element is not None and element.role is ElementRole.MANIFOLD):
        return (name,)
    found = [key for key, filling in known.items() if filling == name]
    if name in making.binding.fillings:
        found = [making.binding.fillings[name]]
    if len(found) == 1:
        return (found[0],)
    if found:
        message = f"{name!r} is in {', '.join(found)}: name one of them"
        making.told.tell("plan.cartridge_ambiguous", message, place)
    else:
        message = f"the rig has no cartridge with {name!r}"
        making.told.tell("plan.no_cartridge", message, place, filling=name)
    return None


def nanolitres(making: Making, volume_ml: Any, place: FilePlace) -> int | None:  # noqa: ANN401
    """Return a volume of a recipe; None: it is no volume that can be moved, which is told."""
    return on_grid(making, Decimal(volume_ml), "mL", place)


def on_grid(making: Making, amount: Decimal, unit: str, place: FilePlace) -> int | None:
    """Return mL as nanolitres, or g as micrograms; None: it is no whole number, which is told."""
    grains, said = Fraction(amount) * GRAINS, f"{amount.normalize():f} {unit}"
    if grains <= 0:
        message = f"{making.operation}: {said} is nothing that can be moved or added"
        making.told.tell("unit.not_positive", message, place)
    elif grains >= MOST_GRAINS:
        message = f"{making.operation}: {said} is more than any laboratory handles"
        making.told.tell("unit.too_large", message, place)
    elif grains.denominator != 1:
        grain = "nanolitre" if unit == "mL" else "microgram"
        message = (
            f"{making.operation}: {said} is finer than one {grain}, in whole numbers of which all "
            f"is kept; write such a number"
        )
        making.told.tell("unit.off_grid", message, place)
    else:
        return int(grains)
    return None


def move_volume(making: Making, move: RigMove, amount_nl: int, lot: str = "") -> None:
    """Move a volume: in as many parts as flask and waste ask for."""
    if is_under_vacuum(making, move.place, move.source, move.target):
        return
    is_waste = making.equipment.sort(move.target) is VesselSort.WASTE
    if is_waste and _overfills(making, move, amount_nl):
        return
    fits = is_waste or look_for_room(making, move, Fraction(amount_nl), Fraction(amount_nl))
    left = amount_nl
    while left:
        part = _supply(making, move, left, lot) if lot else left
        if is_waste:
            part = min(part, making.capacity_nl(move.target) or part)
        if is_waste or (fits and left < amount_nl):
            look_for_room(making, move, Fraction(part), Fraction(part))
        is_enough = bool(lot) or _holds(making, move, part)
        groups = route(making, move, part) if is_enough else None
        if groups is None:
            return
        keeps = keeps_solids(making, move)
        portion = making.matter.draw(move.source, part, keeps_solids=keeps)
        does = {"kind": move.kind, "from": move.source, "to": move.target, "volume_ul": micro(part)}
        does |= {"through": list(move.through) or None, "lot": lot or None}
        _finish(making, move, portion, does, groups)
        if lot:
            making.taken_nl[move.source] = making.taken_nl.get(move.source, 0) + part
        left -= part


def is_drawn_dry(making: Making, move: RigMove) -> bool:
    """Tell whether all of a vessel is asked for that steps before have emptied; that is noted."""
    if move.source in making.lost or not making.matter.is_empty_again(move.source):
        return False
    step = f"{making.operation} in line {move.place.line}"
    making.note(f"{step}: {move.source} is empty already: nothing is moved to {move.target}")
    return True


def move_all(making: Making, move: RigMove) -> None:
    """Move all liquid of a vessel, drawing until nothing more comes."""
    if is_under_vacuum(making, move.place, move.source, move.target):
        return
    liquid = making.matter.liquid(move.source)
    if move.source in making.lost:
        making.lost.add(move.target)
        route(making, move, NL_PER_ML)
        return
    if not liquid.most:
        message = (
            f"{move.source} holds nothing that could be moved to {move.target}; what is in it from "
            "before is said with --holds VESSEL=REAGENT:VOLUME"
        )
        making.told.tell("plan.nothing_there", message, move.place)
        return
    capacity = making.capacity_nl(move.target)
    is_waste = making.equipment.sort(move.target) is VesselSort.WASTE
    if is_waste and _overfills(making, move, int(liquid.most)):
        return
    while is_waste and capacity and liquid.is_certain and liquid.most > capacity:
        before = liquid.most
        move_volume(making, replace(move, kind="transfer"), capacity)
        liquid = making.matter.liquid(move.source)
        if liquid.most == before:
            return
    most_nl = -(-liquid.most.numerator // liquid.most.denominator)
    look_for_room(making, move, liquid.least, liquid.most)
    groups = route(making, move, most_nl)
    if groups is None:
        return
    portion = making.matter.draw_all(move.source, keeps_solids=keeps_solids(making, move))
    does = {"kind": move.kind, "from": move.source, "to": move.target, "all": True}
    does |= {"most_ul": micro(most_nl), "through": list(move.through) or None}
    if move.kind == "filter":
        does = {"kind": "filter", "vessel": move.source, "to": move.target}
        does |= {"most_ul": micro(most_nl)}
    _finish(making, move, portion, does, until(groups, "empty"))


def _overfills(making: Making, move: RigMove, amount_nl: int) -> bool:
    """Tell whether a waste would have to be emptied too often for a move, which is then told."""
    capacity = making.capacity_nl(move.target)
    if not capacity or amount_nl <= MOST_PARTS * capacity:
        return False
    message = (
        f"{render_volume(amount_nl)} fill {move.target}, which holds {capacity / 1000:g} µL, "
        f"more than {MOST_PARTS} times: give the rig a larger waste"
    )
    facts = {"vessel": move.target, "needed_ul": micro(amount_nl)}
    making.told.tell("plan.overflow", message, move.place, **facts)
    return True


def until(groups: list[Group], end: str) -> list[Group]:
    """Let the strokes out of the source end when nothing more comes, or at the boundary."""
    first = next((c["device"] for g in groups for c in g if c["action"] == "aspirate"), "")
    return [[_until(c, end) if c["device"] == first else c for c in group] for group in groups]


def _until(command: DeviceCommand, end: str) -> DeviceCommand:
    if command["action"] != "aspirate":
        return command
    parameters = {**command["parameters"], "until": end}
    return DeviceCommand(device=command["device"], action=command["action"], parameters=parameters)


def _finish(
    making: Making, move: RigMove, portion: Portion, does: dict[str, Any], groups: list[Group]
) -> None:
    brought = making.traces_out_of(move.source, portion)
    film = making.film(used_parts(groups), most_of(portion), move.target, brought)
    making.wet(portion, groups, round(1000 * does.get("volume_ul", 0)), {move.target})
    if move.through:
        portion = {key: share for key, share in portion.items() if not key[1]}
    look_at_meeting(making, move.source, move.target, portion, move.place, film)
    making.bring(move.target, portion, move.source)
    if not making.matter.held(move.source):
        making.meetings.drain(move.source)
    checks = making.take_checks()
    making.add(move.place, does, [*checks, *groups, *rejoin(making, groups)])


def rejoin(making: Making, groups: list[Group]) -> list[Group]:
    """Turn valves that held gas on a vessel back to where they stood."""
    turned = {c["device"] for g in groups for c in g if c["action"] == "set_port"}
    back = [
        say(valve, "set_port", port=port)
        for valves in making.joined.values()
        for valve, port in valves.items()
        if valve in turned
    ]
    return [back] if back else []


def _supply(making: Making, move: RigMove, wanted_nl: int, lot: str) -> int:
    """See to it that a flask holds what is to be drawn; return how much of it at once."""
    held = making.matter.liquid(move.source).least
    capacity = making.capacity_nl(move.source)
    if making.needed_nl is None:
        making.bring(move.source, {(lot, False): exactly(wanted_nl)})
        return wanted_nl
    if held >= wanted_nl:
        return wanted_nl
    if held > 0 and capacity is not None:
        return int(held)
    left = making.needed_nl.get(move.source, wanted_nl) - making.taken_nl.get(move.source, 0)
    fill(making, move.source, lot, max(left, wanted_nl), move.place)
    return min(wanted_nl, int(making.matter.liquid(move.source).least))


def fill(making: Making, flask: str, lot: str, needed_nl: int, place: FilePlace) -> None:
    """Let a person fill a flask with what is still needed, as far as it holds it.

    Where more may be left in it than is sure, a person first sees that there is room.
    """
    held = making.matter.liquid(flask)
    capacity = making.capacity_nl(flask)
    amount = needed_nl - int(held.least)
    if capacity is not None:
        amount = min(amount, capacity - int(held.least))
    if amount <= 0:
        return
    room = f"{flask} has room for {render_volume(amount)}"
    is_sure = capacity is None or held.most + amount <= capacity
    looks = [] if is_sure else [[say(BY_HAND, "check", text=room)]]
    making.bring(flask, {(lot, False): exactly(amount)})
    text = f"Fill {render_volume(amount)} of {lot} into {flask}"
    action = say(BY_HAND, "fill", vessel=flask, lot=lot, volume_ul=amount / 1000, text=text)
    does = {"kind": "fill", "to": flask, "lot": lot, "volume_ul": amount / 1000}
    with making.naming("Prepare"):
        making.add(place, does, [*looks, [action]])


def _holds(making: Making, move: RigMove, amount_nl: int) -> bool:
    liquid = making.matter.liquid(move.source)
    if move.source in making.lost:
        making.lost.add(move.target)
        return False
    if liquid.least >= amount_nl:
        return True
    if liquid.most >= amount_nl:
        text = f"At least {render_volume(amount_nl)} can be drawn from {move.source}"
        making.ask_first(text, vessel=move.source, least_ul=micro(amount_nl))
        making.matter.find_at_least(move.source, amount_nl)
        return True
    message = (
        f"{render_volume(amount_nl)} is to be drawn from {move.source}, which holds at most "
        f"{render_volume(int(liquid.most))}"
    )
    making.told.tell("plan.too_little", message, move.place)
    return False


def look_for_room(making: Making, move: RigMove, least: Fraction, most: Fraction) -> bool:
    """Look for room in the target: empty a waste, ask where nobody knows, refuse what overflows.

    Returns:
        Whether there may be room; False: there is none, which is told.
    """
    capacity, held = making.capacity_nl(move.target), making.matter.liquid(move.target)
    if move.target in making.lost:
        return True
    if capacity is None or held.most + most <= capacity:
        return True
    if making.equipment.sort(move.target) is VesselSort.WASTE and most <= capacity:
        empty(making, move.target, move.place)
        return True
    if held.least + least <= capacity:
        text = f"{move.target} has room for {render_volume(int(most))}"
        making.ask_first(text)
        return True
    message = (
        f"{move.target} holds {render_volume(capacity)}; {render_volume(int(held.least))} is in it "
        f"and {render_volume(int(least))} is to come"
    )
    # What follows is judged as if there were room, so that everything is told at once.
    needed_ul = micro(held.least + least)
    making.told.tell("plan.overflow", message, move.place, vessel=move.target, needed_ul=needed_ul)
    return False


def empty(making: Making, vessel: str, place: FilePlace) -> None:
    """Let a person empty a waste."""
    making.matter.empty(vessel)
    making.meetings.forget(vessel)
    action = say(BY_HAND, "empty", vessel=vessel, text=f"Empty {vessel}")
    with making.naming("Prepare"):
        making.add(place, {"kind": "empty", "vessel": vessel}, [[action]])


def keeps_solids(making: Making, move: RigMove) -> bool:
    """Tell whether what a move leaves behind are the solids on a filter."""
    if making.equipment.sort(move.source) is not VesselSort.FILTER:
        return False
    element = making.equipment.elements[move.source]
    return (move.source_port or element.leave_by or "bottom") == "bottom"


def is_under_vacuum(making: Making, place: FilePlace, *vessels: str) -> bool:
    """Tell whether nothing can be put into or taken out of a vessel, which is then told."""
    for vessel in vessels:
        key = vessel.partition("#")[0]
        if any(making.is_evacuated(owner) for owner in making.equipment.shares_vacuum(vessel)):
            message = f"{key} is under vacuum: nothing can be put into it or taken out of it"
            making.told.tell("plan.under_vacuum", message, place)
            return True
    return False
