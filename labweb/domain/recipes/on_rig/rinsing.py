"""Steps that rinse the syringes and lines, or blow them out."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import pairwise, permutations
from math import inf

from labweb.domain.graph.elements import ElementRole
from labweb.domain.recipes.on_rig.chemistry import Clash
from labweb.domain.recipes.on_rig.equipment import INERT, VesselSort
from labweb.domain.recipes.on_rig.films import carried, flowing, is_barred, unwelcome
from labweb.domain.recipes.on_rig.making import Making
from labweb.domain.recipes.on_rig.matter import Key, micro
from labweb.domain.recipes.on_rig.matter import lots as names
from labweb.domain.recipes.on_rig.meetings import Pour, RigFilm, most_of
from labweb.domain.recipes.on_rig.moving import move_volume, nanolitres
from labweb.domain.recipes.on_rig.wastes import (
    choose_waste,
    clash_at,
    film_of,
    takes,
    tell_clash,
    tell_trace,
)
from labweb.domain.recipes.on_rig.ways import RigMove, chain_of, parts_of, route
from labweb.domain.recipes.xdl.expansion.act_reading import default_number
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicOperation
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace


def rinse_lines(making: Making, operation: BasicOperation) -> None:
    """Flush a solvent through to the nearest waste that takes it and what still wets the lines."""
    name = str(operation.fields.get("solvent", ""))
    flasks = making.binding.reagents.get(name)
    volume = operation.fields.get("volume_ml")
    if not flasks or volume is None:
        making.told.tell(
            "xdl.left_open", "which solvent, and how much of it, is not said", operation.place
        )
        return
    amount = nanolitres(making, volume, operation.place)
    moves = {
        key: RigMove(source=flasks[0], target=key, place=operation.place, kind="clean")
        for key in _wastes(making)
    }
    waste = choose_waste(making, flasks[0], operation.place, way=lambda key: moves[key])
    if amount is None or waste is None:
        return
    clear(making, moves[waste], name)
    repeats = operation.fields.get("repeats", 1)
    for _ in range(repeats if isinstance(repeats, int) else 1):
        _rinse_once(making, moves[waste], name, amount)


def _wastes(making: Making) -> list[str]:
    return [key for key, sort in making.equipment.vessels.items() if sort is VesselSort.WASTE]


FLUSH_NL = 5_000_000
"""Volume of gas that is pushed through the lines.

Source:
    Default of the published XDL compiler for Chemputers: 5 mL."""


def flush_lines(making: Making, operation: BasicOperation) -> None:
    """Push gas through the syringes into each waste that a source of gas reaches.

    A waste that must not get what wets the lines on the way is left out, which a note says; where
    that is each of them, it is told.
    """
    equipment = making.equipment
    sources = [key for key in sorted(equipment.elements) if equipment.gas(key) in INERT]
    is_any, left_out = False, dict[str, Clash]()
    for waste in _wastes(making):
        ways = [(chain_of(making, gas, waste), gas) for gas in sources]
        known = [(len(chain.pumps), gas) for chain, gas in ways if chain is not None]
        if not known:
            continue
        move = RigMove(source=min(known)[1], target=waste, place=operation.place)
        film = film_of(making, move)
        clash = clash_at(making, waste, film)
        if clash is not None:
            left_out[waste] = clash
            making.note(f"no gas is pushed through the lines into {waste}: {clash}")
            continue
        is_any = True
        groups = route(making, move, FLUSH_NL)
        if groups is not None:
            making.meetings.pour(waste, film)
            does = {"kind": "flush", "from": move.source, "to": waste, "volume_ul": micro(FLUSH_NL)}
            making.add(operation.place, does, groups)
    if left_out and not is_any:
        for waste, clash in left_out.items():
            tell_clash(making, "what wets the lines", waste, clash, operation.place)
    elif not is_any:
        message = "no pump pushes an inert gas into a waste"
        making.told.tell("plan.no_gas", message, operation.place)


RINSE_NL = int(1_000_000 * default_number("rinse.volume"))
_REPEATS, _HARD_REPEATS = (
    int(default_number(f"rinse.{name}")) for name in ("repeats", "incompatible_repeats")
)


def rinse(making: Making, move: RigMove, lot: str) -> None:
    """Rinse the syringes of a move that another liquid was in, where a reagent for it is named."""
    clear(making, move, lot)
    chain = chain_of(making, move.source, move.target) if making.rinses else None
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
        if making.chemistry.clash({reagent}, coming) is not None:
            continue
        if _is_barred(making, reagent, [move]):
            continue
        left = _wash(making, reagent, dirty, move.place, _REPEATS)
        for key in sorted(left):
            flask = making.binding.reagents[reagent][0]
            making.note(f"{key} is not rinsed: no way from {flask} to a waste leads over it")


def clear(making: Making, move: RigMove, lot: str = "", among: Collection[RigMove] = ()) -> None:
    """Wash what must not meet the next liquid out of the syringes and valves on its way.

    Nor may what wets them meet what is in its vessel, if that is one of the recipe. Moves among
    which it is one step carry what wets the lines of each into the vessels of all.

    What the move itself brings onto the other in its vessel is no such liquid: the recipe means it.
    Where no solvent that is named for rinsing goes with both, alone or one after another, or none
    gets there, it is told.
    """
    if not making.meetings.is_any:
        return
    coming = _coming(making, move, lot)
    parts = parts_of(making, move)
    meant = _meant(making, move)
    dirty = {part for part in parts if _clash(making, part, coming, meant)}
    dirty |= {part for part in parts if _fouls(making, part, move.target, coming)}
    _note_meant(making, move, parts, coming, meant)
    moves = among or [move]
    all_parts = parts.union(*(parts_of(making, one) for one in among))
    lots = flowing(making, move, lot)
    fouls = {clash.coming for clash in carried(making, all_parts, move, lots)}
    fouls |= unwelcome(making, all_parts, move.target, lots)
    wet = {part: {name for name, _ in making.residues.get(part, {})} for part in all_parts}
    dirty |= {part for part in all_parts if not fouls.isdisjoint(wet[part])}
    residue = set[str]().union(*(wet[part] for part in dirty))
    for reagent in _solvents(making, residue, names(coming.amounts), moves) if dirty else ():
        _wash(making, reagent, dirty, move.place, _HARD_REPEATS)
    found = ((part, _clash(making, part, coming, meant)) for part in sorted(dirty))
    for part, clash in found:
        if clash is not None:
            message = (
                f"{part}, on the way from {move.source} to {move.target}: {clash}, which was in it "
                "last: name a solvent that goes with both for rinsing (--rinse, or "
                "use_for_cleaning in the recipe), declare its groups, and have its flask where a "
                f"way over {part} leads to a waste that takes it"
            )
            facts = {"there": clash.there, "coming": clash.coming, "device": part}
            making.told.tell("plan.no_rinse", message, move.place, **facts)
            return
    _look_at_film(making, move, all_parts, lots)


def _look_at_film(
    making: Making, move: RigMove, parts: Collection[str], lots: Collection[Key]
) -> None:
    """Tell what still wets the lines and must not come onto what is in a vessel of the recipe."""
    clash = next(iter(carried(making, parts, move, lots)), None)
    if clash is None:
        return
    is_wet = (clash.coming, False), (clash.coming, True)
    wet = sorted(p for p in parts if any(lot in making.residues.get(p, {}) for lot in is_wet))
    if not wet:
        making.met_traces.add(clash.coming)
        tell_trace(making, move.source, clash, move.place)
        return
    message = (
        f"{wet[0]}, on the way from {move.source} to {move.target}, is wet with {clash.coming}, "
        f"which goes with it: {clash}, which is in {move.target}: name a solvent that goes with "
        "both for rinsing (--rinse, or use_for_cleaning in the recipe), declare its groups, and "
        f"have its flask where a way over {wet[0]} leads to a waste that takes it"
    )
    facts = {"there": clash.there, "coming": clash.coming, "device": wet[0]}
    making.told.tell("plan.no_rinse", message, move.place, **facts)


def _is_barred(making: Making, reagent: str, moves: Collection[RigMove]) -> bool:
    """Tell whether a rinse would leave what must not go on into a vessel of the recipe."""
    if not making.meetings.is_any:
        return False
    parts = frozenset[str]().union(*(parts_of(making, move) for move in moves))
    ends = {end for move in moves for end in (move.target, move.onto) if end}
    return any(is_barred(making, reagent, end, parts) for end in ends)


def _coming(making: Making, move: RigMove, lot: str) -> Pour:
    """Return what comes next; nobody has said yet how much of it."""
    held = making.matter.held(move.source)
    lots = {(lot, False)} if lot else most_of(held).keys()
    return Pour(dict.fromkeys(lots, inf), making.meetings.of(move.source))


def _fouls(making: Making, part: str, target: str, coming: Pour) -> bool:
    """Tell whether a waste must not get what wets a part that is flushed into it."""
    film = making.film((part,), coming.amounts)
    return making.meetings.keeps_apart(target) and clash_at(making, target, film) is not None


def _meant(making: Making, move: RigMove) -> frozenset[Key]:
    """Return what the recipe brings the next liquid onto."""
    is_waste = making.meetings.keeps_apart(move.target)
    return frozenset(() if is_waste else most_of(making.matter.held(move.target)))


def _note_meant(
    making: Making,
    move: RigMove,
    parts: Collection[str],
    coming: Pour,
    meant: Collection[Key],
) -> None:
    films = (making.residues.get(part, {}) for part in parts)
    found = (_told(making, {k: one for k, one in f.items() if k in meant}, coming) for f in films)
    clash = next((one for one in found if one is not None), None)
    if clash is not None and not making.rinses:
        making.note(
            f"{clash.coming} follows {clash.there} through the same syringes, undiluted "
            f"({clash.outcome}); the recipe lets them meet in {move.target}: name a solvent for "
            "rinsing to keep them apart until then"
        )


def _clash(making: Making, part: str, coming: Pour, meant: Collection[Key] = ()) -> Clash | None:
    films = making.residues.get(part, {})
    return _told(making, {lot: film for lot, film in films.items() if lot not in meant}, coming)


def _told(making: Making, films: Mapping[Key, RigFilm], coming: Pour) -> Clash | None:
    found = making.meetings.first_on({lot: film.amount for lot, film in films.items()}, coming)
    return None if found is None else making.chemistry.told(*found)


def _solvents(
    making: Making, residue: Collection[str], coming: Collection[str], moves: Collection[RigMove]
) -> tuple[str, ...]:
    """Return what leads from a residue to the next liquid: one solvent, else two, each declared."""
    known = [name for name in making.rinses if making.chemistry.groups.get(name)]
    rows = [(one,) for one in known] + list(permutations(known, 2))
    for row in rows:
        met = [residue, *({name} for name in row), coming]
        is_free = not any(making.chemistry.clash(one, other) for one, other in pairwise(met))
        if is_free and not _is_barred(making, row[-1], moves):
            return row
    return ()


def _wash(
    making: Making, reagent: str, dirty: Collection[str], place: FilePlace, repeats: int
) -> set[str]:
    """Rinse syringes and valves with a reagent into a waste; return those that it does not reach.

    It goes over nothing and into nothing that it must not meet.
    """
    left = set(dirty)
    pumps = [
        part for part in sorted(dirty) if making.equipment.elements[part].role is ElementRole.PUMP
    ]
    for over in (None, *pumps):
        if over is not None and over not in left:
            continue
        ways = _rinse_ways(making, reagent, place, over)
        while left and ways:
            move, reached = max(ways, key=lambda way: _worth(making, way, left))
            if not reached & left:
                break
            for _ in range(repeats):
                _rinse_once(making, move, reagent, RINSE_NL)
            left -= reached
    return left


def _worth(
    making: Making, way: tuple[RigMove, frozenset[str]], left: Collection[str]
) -> tuple[int, int, str]:
    """Rank a way: how much it cleans, and into a waste that has what wets the lines already."""
    move, parts = way
    is_new = making.meetings.new_in(move.target, making.film(parts).amounts)
    return len(parts.intersection(left)), -is_new, move.target


def _rinse_ways(
    making: Making, reagent: str, place: FilePlace, over: str | None
) -> list[tuple[RigMove, frozenset[str]]]:
    """Return the ways of a rinse into wastes that take it, each with what it goes over."""
    flask = making.binding.reagents[reagent][0]
    ways = []
    for waste in _wastes(making):
        move = RigMove(source=flask, target=waste, place=place, kind="clean", over=over)
        parts = parts_of(making, move)
        solvent = Pour({(reagent, False): inf})
        film = making.film(parts, solvent.amounts)
        met = (clash_at(making, waste, one) for one in (solvent, film))
        is_free = not any(_clash(making, part, solvent) for part in parts) and not any(met)
        if parts and is_free and takes(making, waste, {reagent}):
            ways.append((move, parts))
    return ways


def _rinse_once(making: Making, move: RigMove, lot: str, amount_nl: int) -> None:
    making.rinsed_nl[lot] = making.rinsed_nl.get(lot, 0) + amount_nl
    with making.naming("Rinse"):
        move_volume(making, move, amount_nl, lot=lot)
