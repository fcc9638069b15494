"""Which waste takes what: by the streams that it says, and never onto what it must not meet."""

from __future__ import annotations

from collections.abc import Callable, Collection
from math import inf

from labweb.domain.graph.syringe_chain import SyringeChain
from labweb.domain.recipes.on_rig.chemistry import Clash
from labweb.domain.recipes.on_rig.equipment import VesselSort
from labweb.domain.recipes.on_rig.making import Making
from labweb.domain.recipes.on_rig.matter import Key, Portion
from labweb.domain.recipes.on_rig.matter import lots as names
from labweb.domain.recipes.on_rig.meetings import NO_FILM, Pour, most_of
from labweb.domain.recipes.on_rig.ways import RigMove, chain_of, parts_of
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace


def choose_waste(
    making: Making,
    source: str,
    place: FilePlace,
    lots: Collection[str] | None = None,
    way: Callable[[str], RigMove] | None = None,
    chain: Callable[[str], SyringeChain | None] | None = None,
) -> str | None:
    """Choose the nearest waste that may take what comes from a vessel.

    One that may not get what wets the lines on the way comes last: it is washed out before.

    Args:
        making: The plan so far.
        source: The vessel that it comes from.
        place: Where in the recipe.
        lots: What comes; None: what is in the source.
        way: Waste → the move into it; without it, a plain transfer.
        chain: Waste → the way that leads to it, or None; without it, the one with the fewest tubes.

    Returns:
        The waste; None: there is none, which is told with what would cure it.
    """
    flows = {(lot, False): inf for lot in lots or ()}
    coming = _leaving(making, source) if lots is None else Pour(flows)
    wastes = [key for key, sort in making.equipment.vessels.items() if sort is VesselSort.WASTE]
    ways = {key: chain_of(making, source, key) if chain is None else chain(key) for key in wastes}
    reached = {key: len(found.pumps) for key, found in ways.items() if found is not None}
    if not reached:
        message = f"{source} reaches no waste of the rig"
        making.told.tell("plan.no_waste", message, place, vessel=source)
        return None
    named = names(coming.amounts)
    fit = [key for key in reached if takes(making, key, named)]
    free = [key for key in fit if clash_at(making, key, coming) is None]
    if free:

        def rank(waste: str) -> tuple[bool, int, str]:
            move = RigMove(source=source, target=waste, place=place) if way is None else way(waste)
            film = film_of(making, move, coming.amounts)
            return clash_at(making, waste, film) is not None, reached[waste], waste

        return min(free, key=rank)
    if fit:
        nearest = min((reached[key], key) for key in fit)[1]
        clash = clash_at(making, nearest, coming)
        if clash is not None:
            tell_clash(making, source, nearest, clash, place, named)
    else:
        _tell_stream(making, source, sorted(reached), named, place)
    return None


def _leaving(making: Making, source: str) -> Pour:
    """Return what may leave a vessel: of a filter no solid, of a flask its reagent."""
    keeps = making.equipment.sort(source) is VesselSort.FILTER
    held = making.matter.held(source)
    found = most_of({key: share for key, share in held.items() if not (keeps and key[1])})
    if source not in making.binding.vessels.values():
        flasks = making.binding.reagents.items()
        found |= {(name, False): inf for name, keys in flasks if source in keys}
    return Pour(found, making.meetings.of(source))


def film_of(making: Making, move: RigMove, coming: Collection[Key] = ()) -> Pour:
    """Return what wets the syringes and valves of a move, beside what comes over them."""
    if not making.meetings.is_any:
        return Pour({})
    brought = making.traces_out_of(move.source, {})
    return making.film(parts_of(making, move), coming, move.target, brought)


def takes(making: Making, waste: str, lots: Collection[str]) -> bool:
    """Tell whether a waste takes the streams of some lots; wastes that are not divided take all."""
    chemistry = making.chemistry
    if not chemistry.takes:
        return True
    said = chemistry.takes.get(waste)
    return said is not None and not chemistry.unknown(lots) and chemistry.streams(lots) <= said


def clash_at(making: Making, waste: str, coming: Pour) -> Clash | None:
    """Return what must not meet in a waste."""
    found = making.meetings.first(waste, coming)
    return None if found is None else making.chemistry.told(*found)


def look_at_meeting(
    making: Making,
    source: str,
    target: str,
    portion: Portion,
    place: FilePlace,
    film: Pour = NO_FILM,
) -> None:
    """Tell what a vessel must not get, and note what wetted the lines as something that it gets.

    What is not certain to come asks for no stream. Of parted phases nobody knows which lot is in
    which: whoever names the waste in the recipe has said it. A vessel of the recipe gets what that
    says, but onto nothing, and nothing onto it, that was left in a vessel before, and onto nothing
    that wet lines alone have brought there.
    """
    if not making.meetings.keeps_apart(target):
        clash = _clash_of_left(making, source, target, portion)
        if clash is not None:
            tell_clash(making, source or "a person", target, clash, place)
        _look_at_traces(making, source, target, portion, place)
        making.meetings.trace(target, film.amounts, making.matter.held(target))
        return
    certain = {lot for (lot, _), share in portion.items() if share.least}
    clash = clash_at(making, target, Pour(most_of(portion), making.meetings.of(source)))
    wet = clash_at(making, target, film)
    if clash is not None:
        tell_clash(making, source, target, clash, place, names(portion))
    elif wet is not None:
        lots = {*names(portion), *names(film.amounts)}
        making.met_traces.add(wet.coming)
        tell_clash(making, "what wets the lines", target, wet, place, lots)
    elif making.equipment.sort(target) is VesselSort.WASTE and not takes(making, target, certain):
        _tell_stream(making, source, [target], certain, place)
    making.meetings.pour(target, film)


def _clash_of_left(making: Making, source: str, target: str, portion: Portion) -> Clash | None:
    """Return what was left in a vessel before and what must not meet it, in a vessel of the recipe.

    Where it comes from, or was before, does not count: only how much of the two has met.
    """
    there, coming = most_of(making.matter.held(target)), most_of(portion)
    own, brought = making.meetings.of(target), making.meetings.of(source)
    for one in sorted(there):
        for other in sorted(coming):
            is_left = not making.leftovers.isdisjoint((one[0], other[0]))
            has_met = (
                brought.get((other, one), 0) >= there[one]
                or own.get((one, other), 0) >= coming[other]
            )
            if is_left and not has_met and making.meetings.is_pair(one, other):
                return making.chemistry.told(one[0], other[0])
    return None


def _look_at_traces(
    making: Making, source: str, target: str, portion: Portion, place: FilePlace
) -> None:
    """Tell what comes onto something that wet lines have brought into a vessel before."""
    traces = making.meetings.traces(target, making.matter.held(target))
    met = making.meetings.of(source)
    for lot in sorted(most_of(portion)):
        for trace, amount in sorted(traces.items()):
            if making.meetings.is_pair(lot, trace) and met.get((lot, trace), 0) < amount:
                making.met_traces.add(trace[0])
                tell_trace(making, target, making.chemistry.told(trace[0], lot[0]), place)
                return


def tell_trace(making: Making, vessel: str, clash: Clash, place: FilePlace) -> None:
    """Tell that something comes onto what wet lines have brought into a vessel."""
    message = (
        f"{clash}, which wetted the lines when something else went into {vessel} before: name a "
        f"solvent that goes with both for rinsing {clash.there} out of them (--rinse, or "
        "use_for_cleaning in the recipe), and declare its groups"
    )
    facts = {"there": clash.there, "coming": clash.coming, "vessel": vessel}
    making.told.tell("plan.no_rinse", message, place, **facts)


def tell_clash(
    making: Making,
    source: str,
    waste: str,
    clash: Clash,
    place: FilePlace,
    lots: Collection[str] = (),
) -> None:
    """Tell what must not meet in a vessel, and what would cure it; `lots` come with the one."""
    message = (
        f"{source} to {waste}: {clash}, which is in {waste}, and no vessel of the recipe has "
        "brought as much of the two together: give the rig another waste, let a person empty this "
        "one before, or make the one harmless in the recipe first"
    )
    is_waste = making.equipment.vessels.get(waste) is VesselSort.WASTE
    streams = making.chemistry.streams({clash.coming, *lots}) if making.chemistry.takes else ()
    facts: dict[str, object] = {"there": clash.there, "coming": clash.coming}
    facts |= {"is_waste": is_waste, "streams": sorted(streams)}
    making.told.tell("plan.incompatible", message, place, waste=waste, vessel=source, **facts)


def _tell_stream(
    making: Making, source: str, wastes: list[str], coming: Collection[str], place: FilePlace
) -> None:
    chemistry = making.chemistry
    unknown = chemistry.unknown(coming)
    if unknown:
        listed = ", ".join(unknown)
        message = (
            f"the wastes of the rig are divided, and nobody says what {listed} is, of {source}: "
            "declare its groups (`groups` beside the recipe or at its flask, or its CAS number)"
        )
        making.told.tell("plan.unknown_chemistry", message, place, vessel=source, lots=unknown)
        return
    streams = sorted(chemistry.streams(coming))
    offered = "; ".join(
        f"{key} takes {', '.join(sorted(chemistry.takes.get(key, ()))) or 'nothing that it says'}"
        for key in wastes
    )
    message = (
        f"what comes from {source} ({', '.join(sorted(coming))}) is or may be "
        f"{', '.join(streams)}, and no waste that it reaches takes all of it: {offered}. "
        "Say in the recipe into which waste, or let one say that it takes them"
    )
    facts = {"streams": streams, "wastes": wastes}
    making.told.tell("plan.no_stream", message, place, vessel=source, **facts)
