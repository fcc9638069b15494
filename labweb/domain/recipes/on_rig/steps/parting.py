"""Steps that part: phases in a separator, liquid from a solid on a filter."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from labweb.domain.recipes.on_rig.choosing import resolve
from labweb.domain.recipes.on_rig.equipment import VesselSort
from labweb.domain.recipes.on_rig.making import BY_HAND, Making, say, used_parts
from labweb.domain.recipes.on_rig.matter import micro
from labweb.domain.recipes.on_rig.meetings import most_of
from labweb.domain.recipes.on_rig.moving import (
    NL_PER_ML,
    conductors,
    is_drawn_dry,
    look_for_room,
    move_all,
    nanolitres,
    until,
)
from labweb.domain.recipes.on_rig.rinsing import clear, rinse
from labweb.domain.recipes.on_rig.steps.liquids import port_of, rates_of
from labweb.domain.recipes.on_rig.wastes import look_at_meeting
from labweb.domain.recipes.on_rig.ways import RigMove, route
from labweb.domain.recipes.xdl.expansion.basic_operations import BUFFER, WASTE, BasicOperation
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace
from labweb.domain.workflows.passes.liquids.stroke_pipeline import DeviceCommand, Group


def draw_filtrate(making: Making, operation: BasicOperation) -> None:
    """Draw the liquid of a filter off; solids stay. Of a rotary evaporator it is a transfer."""
    source = making.vessel(operation)
    if source is None:
        return
    sort = making.equipment.sort(source)
    if sort not in (VesselSort.FILTER, VesselSort.ROTAVAP):
        message = f"{source} is a {sort}: nothing keeps a solid back in it"
        making.told.tell("plan.no_filter", message, operation.place)
        return
    target = resolve(making, str(operation.fields.get("target", WASTE)), source, operation.place)
    if target is None:
        return
    draw, push = rates_of(making, operation, 1)
    move = RigMove(
        source=source,
        target=target,
        place=operation.place,
        kind="filter" if sort is VesselSort.FILTER else "transfer",
        draw_rate_ul_s=draw,
        push_rate_ul_s=push,
    )
    if is_drawn_dry(making, move):
        return
    rinse(making, move, "")
    move_all(making, move)


def separate_phases(making: Making, operation: BasicOperation) -> None:
    """Draw the lower phase off until the boundary is seen, then the upper one."""
    vessel = making.vessel(operation)
    if vessel is None:
        return
    if making.equipment.sort(vessel) is not VesselSort.SEPARATOR:
        message = f"{vessel} is a {making.equipment.sort(vessel)} and no separator"
        making.told.tell("plan.no_separator", message, operation.place)
        return
    liquid = making.matter.liquid(vessel)
    if not liquid.most and vessel not in making.lost:
        message = f"{vessel} holds nothing that could be parted"
        making.told.tell("plan.nothing_there", message, operation.place)
        return
    ends = _phase_ends(making, operation, vessel)
    if ends is None or not _draw_phases(making, operation, vessel, ends):
        found = [end for end in ends or () if end]
        making.lost |= {vessel, *found, *making.buffers, *making.kept}


def _draw_phases(
    making: Making, operation: BasicOperation, vessel: str, ends: tuple[str, str | None, str]
) -> bool:
    """Add the step; False: it cannot be, which is told."""
    liquid = making.matter.liquid(vessel)
    lower, upper, back = ends
    most_nl = -(-liquid.most.numerator // liquid.most.denominator) or NL_PER_ML
    does: dict[str, Any] = {"kind": "separate", "vessel": vessel, "most_ul": micro(most_nl)}
    does["lower_to"], does["upper_to"] = vessel if back else lower, upper or vessel
    moves = _phase_moves(making, operation, ends, vessel)
    if moves is None:
        return False
    for side, move in moves.items():
        does[f"{side}_through"] = list(move.through) or None
    portion_nl = _portion(making, operation, most_nl)
    if portion_nl is None:
        return False
    port = port_of(operation, "lower_port")
    returns = RigMove(source=back, target=vessel, place=operation.place, target_port=port)
    every = [*moves.values(), *([returns] if back else [])]
    for move in moves.values():
        clear(making, move, among=every)
    conducts = str(operation.fields.get("conducting_phase") or "")
    actions: list[Group] | None = [[_watch(making, vessel, begins=True, conducts=conducts)]]
    count = -(-most_nl // portion_nl)
    actions = _drawn(making, actions, moves["lower"], portion_nl, "boundary", count)
    if actions is not None:
        actions.append([_watch(making, vessel, begins=False)])
    if upper is not None:
        actions = _drawn(making, actions, moves["upper"], most_nl, "empty")
    if back:
        actions = _drawn(making, actions, returns, most_nl, "empty")
    if actions is not None:
        if back:
            waits = RigMove(source=vessel, target=back, place=operation.place)
            look_for_room(making, waits, Fraction(0), liquid.most)
        reached = {end for end in (lower, upper, vessel if back else None) if end is not None}
        _parted(making, operation.place, does, actions, reached)
    return actions is not None


MOST_PORTIONS = 500
"""Most portions that a phase is drawn in."""


def _portion(making: Making, operation: BasicOperation, most_nl: int) -> int | None:
    """Return how much of the lower phase is drawn at once; None: that cannot be, which is told."""
    asked = operation.fields.get("step_ml")
    if asked is None:
        return most_nl
    portion_nl = nanolitres(making, asked, operation.place)
    if portion_nl is not None and -(-most_nl // portion_nl) > MOST_PORTIONS:
        message = (
            f"portions of {asked} mL are more than {MOST_PORTIONS}, of as much as there may be: "
            f"{micro(most_nl) / 1000:g} mL"
        )
        making.told.tell("plan.too_many_rounds", message, operation.place)
        return None
    return None if portion_nl is None else min(portion_nl, most_nl)


def _phase_moves(
    making: Making, operation: BasicOperation, ends: tuple[str, str | None, str], vessel: str
) -> dict[str, RigMove] | None:
    """Return how each phase goes; None: through what is not known, which is told."""
    moves = {}
    if ends[1] is None and port_of(operation, "upper_port"):
        making.note(f"the upper phase stays in {vessel}: upper_phase_port has no effect")
    for side, target in zip(("lower", "upper"), ends[:2], strict=True):
        name = str(operation.fields.get(f"{side}_through", ""))
        through = conductors(making, name, operation.place)
        if through is None:
            return None
        is_waiting = side == "lower" and bool(ends[2])
        moves[side] = RigMove(
            source=vessel,
            target=target or vessel,
            place=operation.place,
            through=() if is_waiting or target is None else through,
            target_port=None if is_waiting else port_of(operation, f"{side}_port"),
        )
    return moves


def _drawn(
    making: Making,
    actions: list[Group] | None,
    move: RigMove,
    most_nl: int,
    end: str,
    portions_count: int = 1,
) -> list[Group] | None:
    """Add the strokes of one phase; None: there is no way, which is told."""
    for _ in range(portions_count):
        groups = route(making, move, most_nl)
        if groups is None or actions is None:
            return None
        actions = [*actions, *until(groups, end)]
    return actions


def _phase_ends(
    making: Making, operation: BasicOperation, vessel: str
) -> tuple[str, str | None, str] | None:
    """Return where the lower phase is drawn, where the upper one, and a flask it comes back from.

    An upper phase that stays is not moved; a lower one that stays waits in a flask meanwhile.
    """
    names = [str(operation.fields.get(f"{side}_to", WASTE)) for side in ("lower", "upper")]
    waits_in = str(operation.fields.get("waits_in", ""))
    found = []
    back = ""
    for side, name in zip(("lower", "upper"), names, strict=True):
        target = resolve(making, name, vessel, operation.place, waits_in)
        if target == vessel and side == "lower":
            back = resolve(making, BUFFER, vessel, operation.place) or ""
            making.buffers = [key for key in making.buffers if key != back]
            target = back or None
        if target is None:
            return None
        found.append(target)
    lower, upper = found
    if upper == vessel and back:
        message = "both phases are to stay where they are: nothing is parted"
        making.told.tell("plan.same_vessel", message, operation.place)
        return None
    return lower, None if upper == vessel else upper, back


_READS = {"bottom": "falls", "top": "rises"}
"""Which phase conducts better → what the reading does when the upper one comes."""


def _watch(making: Making, vessel: str, *, begins: bool, conducts: str = "") -> DeviceCommand:
    sensor = making.equipment.conductivity(vessel)
    if sensor is not None and not begins:
        return say(sensor, "stop_watching")
    if sensor is not None:
        return say(sensor, "watch_boundary", reading=_READS.get(conducts))
    if begins:
        text = f"Watch {vessel}, and stop the drawing when the boundary of the phases comes"
        text += f"; the {conducts} one conducts better" if conducts else ""
        return say(BY_HAND, "watch", vessel=vessel, text=text)
    text = f"The lower phase of {vessel} is out"
    return say(BY_HAND, "stop_watching", vessel=vessel, text=text)


def _parted(
    making: Making, place: FilePlace, does: dict[str, Any], actions: list[Group], reached: set[str]
) -> None:
    vessel = does["vessel"]
    whole = making.matter.liquid(vessel)
    brought = making.traces_out_of(vessel, {})
    portion = making.matter.part(vessel)
    for side in ("lower", "upper"):
        target = does[f"{side}_to"]
        kept = portion
        if does.get(f"{side}_through"):
            kept = {key: share for key, share in portion.items() if not key[1]}
        if target != vessel:
            film = making.film(used_parts(actions), most_of(portion), target, brought)
            look_at_meeting(making, vessel, target, kept, place, film)
            move = RigMove(source=vessel, target=target, place=place)
            look_for_room(making, move, Fraction(0), whole.most)
        making.bring(target, kept, vessel)
        if vessel in making.lost:
            making.lost.add(target)
    if not making.matter.held(vessel):
        making.meetings.drain(vessel)
    making.wet(portion, actions, 0, reached)
    making.add(place, does, [*making.take_checks(), *actions])
