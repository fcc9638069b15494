"""Steps that bring liquid or solid in, or move liquid."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

from labweb.domain.recipes.on_rig.choosing import resolve
from labweb.domain.recipes.on_rig.equipment import COLLECT, VesselSort
from labweb.domain.recipes.on_rig.making import BY_HAND, Making, say
from labweb.domain.recipes.on_rig.matter import Portion, exactly
from labweb.domain.recipes.on_rig.moving import (
    conductors,
    is_drawn_dry,
    is_under_vacuum,
    move_all,
    move_volume,
    nanolitres,
    on_grid,
)
from labweb.domain.recipes.on_rig.priming import prime, recover
from labweb.domain.recipes.on_rig.rinsing import rinse
from labweb.domain.recipes.on_rig.wastes import look_at_meeting
from labweb.domain.recipes.on_rig.ways import RigMove, chain_of
from labweb.domain.recipes.xdl.expansion.basic_operations import KEPT, BasicOperation
from labweb.domain.recipes.xdl.unfolding.amounts_said_twice import rate_of
from labweb.domain.units import render_volume, steady

_UL_S_PER_ML_MIN = Decimal(1000) / Decimal(60)
VISCOUS_UL_S = Decimal(2000) / 60
"""What is viscous is drawn at 2 mL/min.

Source:
    Default of the published XDL compiler for Chemputers."""


def add_liquid(making: Making, operation: BasicOperation) -> None:
    """Take a volume of a reagent out of its flask into a vessel."""
    target = making.vessel(operation)
    reagent = str(operation.fields.get("reagent", ""))
    flasks = making.binding.reagents.get(reagent)
    through = conductors(making, str(operation.fields.get("through", "")), operation.place)
    if target is not None and (not flasks or through is None):
        making.lost.add(target)
    if target is None or not flasks or through is None:
        return
    source = _nearest(making, flasks, target)
    if source == target:
        message = f"{reagent} is to be added to {target}, which is the flask that it comes out of"
        making.told.tell("plan.same_vessel", message, operation.place)
        return
    amount = _amount(making, operation, source)
    if amount is None:
        return
    draw, push = rates_of(making, operation, amount)
    move = RigMove(
        source=source,
        target=target,
        place=operation.place,
        through=through,
        source_port=port_of(operation, "from_port"),
        target_port=port_of(operation, "to_port"),
        draw_rate_ul_s=draw,
        push_rate_ul_s=push,
    )
    rinse(making, move, reagent)
    prime(making, move, reagent)
    delivered = making.delivered_nl.setdefault(target, {})
    delivered[reagent] = delivered.get(reagent, 0) + amount
    move_volume(making, move, amount, lot=reagent)
    recover(making, move)


def _nearest(making: Making, flasks: tuple[str, ...], target: str) -> str:
    """Return the flask of a reagent with the shortest way to a vessel."""
    ways = [(chain_of(making, flask, target), flask) for flask in flasks]
    known = [(len(chain.pumps), flask) for chain, flask in ways if chain is not None]
    return min(known)[1] if known else flasks[0]


def _amount(making: Making, operation: BasicOperation, source: str) -> int | None:
    volume = operation.fields.get("volume_ml")
    if volume is not None:
        return nanolitres(making, volume, operation.place)
    held = making.matter.liquid(source).least
    stated = sum(amount for _, amount in making.equipment.contents(source))
    if making.needed_nl is None:
        held = held or exactly(stated).least
    if held <= 0:
        message = f"all of {source} is asked for, and the graph does not say how much is in it"
        making.told.tell("plan.nothing_there", message, operation.place)
        return None
    return int(held)


def rates_of(
    making: Making, operation: BasicOperation, amount_nl: int
) -> tuple[float | None, float | None]:
    """Return how fast to draw and to push, where the recipe says so."""
    fields, said = operation.fields, dict[str, Decimal]()
    over_s = fields.get("over_s")
    if isinstance(over_s, Decimal):
        said["time"] = Decimal(amount_nl) / 1000 / over_s if over_s > 0 else Decimal(0)
    for name, value in (
        ("dispense_speed", _ul_s(fields.get("dispense_ml_min"))),
        ("speed", _ul_s(fields.get("rate_ml_min"))),
    ):
        if value is not None:
            said[name] = value
    push = rate_of(making.operation, said, operation.place, making.told)
    if fields.get("is_dropwise") and push is None:
        message = "dropwise says no rate: say a time or a speed as well"
        making.told.tell("xdl.left_open", message, operation.place)
    draw = _ul_s(fields.get("aspirate_ml_min"))
    if draw is not None:
        rate_of(making.operation, {"aspiration_speed": draw}, operation.place, making.told)
    elif fields.get("is_viscous"):
        draw = VISCOUS_UL_S
    return None if draw is None else steady(draw), None if push is None else steady(push)


def _ul_s(ml_min: Any) -> Decimal | None:  # noqa: ANN401 - a field of an operation
    return ml_min * _UL_S_PER_ML_MIN if isinstance(ml_min, Decimal) else None


def port_of(operation: BasicOperation, name: str) -> str | None:
    """Return the port that a recipe names, None when it leaves it to the rig."""
    value = operation.fields.get(name)
    return str(value) if value not in (None, "") else None


def add_solid(making: Making, operation: BasicOperation) -> None:
    """Let a person add a solid: no rig of the supported formats weighs one in."""
    target, mass = making.vessel(operation), operation.fields.get("mass_g")
    if target is None or not isinstance(mass, Decimal):
        return
    micrograms = on_grid(making, mass, "g", operation.place)
    lot = str(operation.fields.get("reagent", ""))
    if micrograms is None or is_under_vacuum(making, operation.place, target):
        return
    text = f"Add {mass.normalize():f} g of {lot} to {target}"
    over_s = operation.fields.get("over_s")
    if isinstance(over_s, Decimal):
        text += f", spread over {over_s.normalize():f} s"
    portion: Portion = {(lot, True): exactly(micrograms)}
    look_at_meeting(making, "", target, portion, operation.place)
    making.bring(target, portion)
    delivered = making.delivered_ug.setdefault(target, {})
    delivered[lot] = delivered.get(lot, 0) + micrograms
    does = {"kind": "add_solid", "to": target, "lot": lot, "mass_ug": micrograms}
    action = say(BY_HAND, "add_solid", vessel=target, lot=lot, mass_ug=micrograms, text=text)
    making.add(operation.place, does, [[action]])


def transfer(making: Making, operation: BasicOperation) -> None:
    """Move a volume, or all of it, from vessel to vessel."""
    name, wanted = str(operation.fields["source"]), str(operation.fields["target"])
    through = conductors(making, str(operation.fields.get("through", "")), operation.place)
    if name.startswith("@"):
        waiting = making.kept if name == KEPT else making.buffers
        source: str | None = waiting.pop() if waiting else None
    else:
        source = resolve(making, name, "", operation.place)
    port = port_of(operation, "from_port")
    if source is not None:
        source, port = _collecting(making, source, port)
    target = None if source is None else resolve(making, wanted, source, operation.place)
    if source is None or target is None or through is None:
        making.lost |= {target} if target is not None else set()
        return
    if source == target:
        message = f"{name} and {wanted} are the same vessel of the rig"
        making.told.tell("plan.same_vessel", message, operation.place)
        return
    target, to_port = _collecting(making, target, port_of(operation, "to_port"))
    volume = operation.fields.get("volume_ml")
    amount = None if volume is None else nanolitres(making, volume, operation.place)
    if volume is not None and amount is None:
        return
    lot = _lot_of(making, source)
    if amount is None and lot:
        amount = _amount(making, operation, source)
    if amount is None and _leaves_rate_open(making, operation, source):
        making.lost |= {source, target}
        return
    draw, push = rates_of(making, operation, amount or int(making.matter.liquid(source).most) or 1)
    move = RigMove(
        source=source,
        target=target,
        place=operation.place,
        through=through,
        source_port=port,
        target_port=to_port,
        draw_rate_ul_s=draw,
        push_rate_ul_s=push,
    )
    _carry_out(making, move, amount, lot)


def _carry_out(making: Making, move: RigMove, amount: int | None, lot: str) -> None:
    """Rinse, prime, move and recover; without an amount move all, but nothing of a reagent."""
    if amount is None and not lot and is_drawn_dry(making, move):
        return
    rinse(making, move, lot)
    if amount is None:
        if lot:
            return
        move_all(making, move)
    else:
        if lot:
            prime(making, move, lot)
            delivered = making.delivered_nl.setdefault(move.target, {})
            delivered[lot] = delivered.get(lot, 0) + amount
        move_volume(making, move, amount, lot=lot)
    recover(making, move)


def _leaves_rate_open(making: Making, operation: BasicOperation, source: str) -> bool:
    """Tell whether a time is said for what nobody knows the amount of, which is then told."""
    there, over_s = making.matter.liquid(source), operation.fields.get("over_s")
    if not isinstance(over_s, Decimal) or there.is_certain:
        return False
    message = (
        f"all of {source} is to be moved in {over_s.normalize():f} s, and between "
        f"{render_volume(int(there.least))} and {render_volume(int(there.most))} are in it then, "
        "so no rate is known that takes this time: say a speed, or leave the time out"
    )
    making.told.tell("plan.uncertain_rate", message, operation.place, vessel=source)
    return True


def _collecting(making: Making, vessel: str, port: str | None) -> tuple[str, str | None]:
    """Return the vessel behind a port: of a rotary evaporator it may be the collecting flask."""
    if port == COLLECT and making.equipment.sort(vessel) is VesselSort.ROTAVAP:
        return making.equipment.collecting(vessel) or vessel, None
    return vessel, port


def _lot_of(making: Making, source: str) -> str:
    """Return the reagent whose flask this is, "" when it is none."""
    if source in making.binding.vessels.values():
        return ""
    return next((name for name, keys in making.binding.reagents.items() if source in keys), "")
