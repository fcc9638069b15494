"""Steps that rinse the syringes and lines, or blow them out."""

from __future__ import annotations

from labweb.domain.workflows.on_rig.equipment import INERT, Sort
from labweb.domain.workflows.on_rig.making import Making
from labweb.domain.workflows.on_rig.matter import micro
from labweb.domain.workflows.on_rig.moving import (
    Move,
    chain_of,
    move_volume,
    nanolitres,
    resolve,
    route,
)
from labweb.domain.workflows.xdl.expansion.basic import WASTE, BasicOperation
from labweb.domain.workflows.xdl.markup import Place


def rinse_lines(making: Making, operation: BasicOperation) -> None:
    """Flush a solvent through to the nearest waste."""
    name = str(operation.fields.get("solvent", ""))
    flasks = making.binding.reagents.get(name)
    volume = operation.fields.get("volume_ml")
    if not flasks or volume is None:
        making.told.tell(
            "xdl.left_open", "which solvent, and how much of it, is not said", operation.place
        )
        return
    amount = nanolitres(making, volume, operation.place)
    waste = resolve(making, WASTE, flasks[0], operation.place)
    repeats = operation.fields.get("repeats", 1)
    for _ in range(repeats if isinstance(repeats, int) else 1):
        if amount is not None and waste is not None:
            _rinse_once(making, flasks[0], waste, name, amount, operation.place)


FLUSH_NL = 5_000_000
"""Volume of gas that is pushed through the lines.

Source:
    Default of the published XDL compiler for Chemputers: 5 mL."""


def flush_lines(making: Making, operation: BasicOperation) -> None:
    """Push gas through the syringes into each waste that a source of gas reaches."""
    equipment = making.equipment
    wastes = [key for key, sort in equipment.vessels.items() if sort is Sort.WASTE]
    sources = [key for key in sorted(equipment.elements) if equipment.gas(key) in INERT]
    is_any = False
    for waste in wastes:
        ways = [(chain_of(making, gas, waste), gas) for gas in sources]
        known = [(len(chain.pumps), gas) for chain, gas in ways if chain is not None]
        if not known:
            continue
        is_any = True
        move = Move(source=min(known)[1], target=waste, place=operation.place)
        groups = route(making, move, FLUSH_NL)
        if groups is not None:
            does = {"kind": "flush", "from": move.source, "to": waste, "volume_ul": micro(FLUSH_NL)}
            making.add(operation.place, does, groups)
    if not is_any:
        message = "no pump pushes an inert gas into a waste"
        making.told.tell("plan.no_gas", message, operation.place)


RINSE_NL = 3_000_000
"""Volume of a rinse.

Source:
    Default of the published XDL compiler for Chemputers: 3 mL to clean the backbone."""


def rinse(making: Making, move: Move, lot: str) -> None:
    """Rinse the syringes of a move that another liquid was in, where a reagent for it is named."""
    if not making.rinses:
        return
    chain = chain_of(making, move.source, move.target)
    if chain is None:
        return
    elements = making.equipment.rig.network.elements
    coming = {lot} if lot else {name for name, _ in making.matter.held(move.source)}
    dirty = {
        key
        for key in (elements[index].key for index in chain.pumps)
        if not making.wetted.get(key, frozenset()) <= coming
    }
    for reagent in making.rinses:
        left = set(dirty)
        flask = making.binding.reagents[reagent][0]
        ways = []
        for waste in (k for k, sort in making.equipment.vessels.items() if sort is Sort.WASTE):
            way = chain_of(making, flask, waste)
            if way is not None:
                ways.append((waste, {elements[index].key for index in way.pumps}))
        while left and ways:
            waste, reached = max(ways, key=lambda way: (len(way[1] & left), way[0]))
            if not reached & left:
                break
            _rinse_once(making, flask, waste, reagent, RINSE_NL, move.place)
            left -= reached
        for key in sorted(left):
            making.note(f"{key} is not rinsed: no way from {flask} to a waste leads over it")


def _rinse_once(
    making: Making, flask: str, waste: str, lot: str, amount_nl: int, place: Place
) -> None:
    making.rinsed_nl[lot] = making.rinsed_nl.get(lot, 0) + amount_nl
    with making.naming("Rinse"):
        move_volume(
            making, Move(source=flask, target=waste, place=place, kind="clean"), amount_nl, lot=lot
        )
