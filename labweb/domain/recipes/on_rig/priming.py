"""What tubes hold: filled before an exact delivery, pushed out by gas after it.

The plan's amounts count tubes as empty. They are right where the tube of a flask is full when the
first volume is drawn out of it, and where nothing is left in the tube to the vessel afterwards.
"""

from __future__ import annotations

from dataclasses import replace

from labweb.domain.graph.port_network import Hop
from labweb.domain.graph.syringe_chain import SyringeChain
from labweb.domain.recipes.on_rig.equipment import INERT, VesselSort
from labweb.domain.recipes.on_rig.making import Making, used_parts
from labweb.domain.recipes.on_rig.matter import micro
from labweb.domain.recipes.on_rig.moving import move_volume, rejoin
from labweb.domain.recipes.on_rig.rinsing import clear, rinse
from labweb.domain.recipes.on_rig.wastes import choose_waste
from labweb.domain.recipes.on_rig.ways import RigMove, chain_of, route
from labweb.domain.recipes.xdl.expansion.act_reading import default_number
from labweb.domain.units import render_volume

_TUBE_VOLUMES = int(default_number("prime.tube_volumes"))


def prime(making: Making, move: RigMove, lot: str) -> None:
    """Fill a tube of a flask, before the first volume that is drawn through it, into a waste."""
    chain = chain_of(making, move.source, move.target) if making.primes else None
    if chain is None:
        return
    amount = _TUBE_VOLUMES * _at_end(chain.hops[0], move.source)[1]
    tube = _drawn_through(chain, move.source)
    if not amount or (move.source, tube) in making.primed:
        return
    making.primed.add((move.source, tube))
    over = chain.hops[0].end

    def way(waste: str) -> SyringeChain | None:
        found = chain_of(making, move.source, waste, over)
        is_same = found is not None and _drawn_through(found, move.source) == tube
        return found if is_same else None

    into = RigMove(
        source=move.source,
        target="",
        place=move.place,
        source_port=move.source_port,
        kind="prime",
        onto=move.target,
        over=making.equipment.rig.network.elements[over].key,
    )
    waste = choose_waste(
        making,
        move.source,
        move.place,
        {lot},
        way=lambda key: replace(into, target=key),
        chain=way,
    )
    if waste is None:
        return
    into = replace(into, target=waste)
    rinse(making, into, lot)
    making.primed_nl[lot] = making.primed_nl.get(lot, 0) + amount
    with making.naming("Prime"):
        move_volume(making, into, amount, lot=lot)
    clear(making, move, lot)


def recover(making: Making, move: RigMove) -> None:
    """Push what is left in the tube to a vessel into it, by gas that takes the same tube.

    No solvent is taken for it: that would change what is in the vessel, and the recipe says it
    (`rinsing_solvent`).
    """
    is_waste = making.equipment.sort(move.target) is VesselSort.WASTE
    if not making.primes or is_waste or move.through:
        return
    chain = chain_of(making, move.source, move.target)
    if chain is None:
        return
    tubes, left = _at_end(chain.hops[-1], move.target)
    if not left:
        return
    for gas in sorted(making.equipment.elements):
        way = chain_of(making, gas, move.target) if making.equipment.gas(gas) in INERT else None
        if way is None or _at_end(way.hops[-1], move.target)[0] != tubes:
            continue
        amount = _TUBE_VOLUMES * left
        push = RigMove(source=gas, target=move.target, place=move.place)
        clear(making, push)
        groups = route(making, push, amount)
        if groups is not None:
            film = making.film(used_parts(groups), (), push.target)
            making.meetings.trace(push.target, film.amounts, making.matter.held(push.target))
            does = {"kind": "push", "from": gas, "to": move.target, "volume_ul": micro(amount)}
            with making.naming("Recover"):
                making.add(move.place, does, [*groups, *rejoin(making, groups)])
        return
    making.note(
        f"up to {render_volume(left)} stay in the tube to {move.target} after each delivery: no "
        "inert gas of the rig is pushed that way"
    )


def _drawn_through(chain: SyringeChain, flask: str) -> frozenset[frozenset[tuple[str, str]]]:
    """Return the tubes at a flask that the first stroke of a way draws through, by their ends."""
    owner = flask.partition("#")[0]
    return frozenset(
        frozenset({(tube.source, tube.source_port), (tube.target, tube.target_port)})
        for tube in chain.hops[0].tubes
        if owner in (tube.source, tube.target)
    )


def _at_end(hop: Hop, vessel: str) -> tuple[frozenset[str], int]:
    """Return what the tubes of a hop at a vessel join, and the volume that they say they hold."""
    owner = vessel.partition("#")[0]
    found = [tube for tube in hop.tubes if owner in (tube.source, tube.target)]
    ends = frozenset(end for tube in found for end in (tube.source, tube.target))
    return ends, sum(tube.dead_volume_nl or 0 for tube in found)
