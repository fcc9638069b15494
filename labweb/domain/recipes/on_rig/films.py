"""What wets the lines and would be carried onto something in a vessel of the recipe."""

from __future__ import annotations

from collections.abc import Collection

from labweb.domain.recipes.on_rig.chemistry import Clash
from labweb.domain.recipes.on_rig.making import Making
from labweb.domain.recipes.on_rig.matter import Key
from labweb.domain.recipes.on_rig.meetings import FILM_NL, most_of
from labweb.domain.recipes.on_rig.moving import keeps_solids
from labweb.domain.recipes.on_rig.ways import RigMove


def flowing(making: Making, move: RigMove, lot: str = "") -> set[Key]:
    """Return the lots that a move brings: a filter and a cartridge keep solids back."""
    if lot:
        return {(lot, False)}
    stay = bool(move.through) or keeps_solids(making, move)
    return {key for key in most_of(making.matter.held(move.source)) if not (stay and key[1])}


def carried(
    making: Making, parts: Collection[str], move: RigMove, coming: Collection[Key]
) -> list[Clash]:
    """List what wets some parts and must not come onto what is in a vessel of the recipe.

    What went over them into that vessel alone, and is in it, the recipe has brought there. Of
    anything else a lot there has to have met as much as the parts keep. What comes as well is no
    film: it is judged as what follows on a wet part. What wet lines have brought into the source
    before goes on.
    """
    meetings, vessel = making.meetings, move.target
    if not meetings.is_any or meetings.keeps_apart(vessel):
        return []
    held = most_of(making.matter.held(vessel))
    brought = meetings.traces(move.source, making.matter.held(move.source))
    met = meetings.of(vessel)
    return [
        making.chemistry.told(there[0], lot[0])
        for lot, amount in sorted(making.film(parts, coming, vessel, brought).amounts.items())
        for there in sorted(held.keys() - {*coming})
        if meetings.is_pair(there, lot) and met.get((there, lot), 0) < amount
    ]


def unwelcome(
    making: Making, parts: Collection[str], vessel: str, coming: Collection[Key]
) -> set[str]:
    """Return what wets some parts and would meet in a vessel of the recipe what comes later."""
    if not making.unwelcome or making.meetings.keeps_apart(vessel):
        return set()
    film = making.film(parts, coming, vessel).amounts
    return {lot for lot, _ in film} & making.unwelcome


def is_barred(making: Making, reagent: str, vessel: str, parts: Collection[str]) -> bool:
    """Tell whether a reagent may not be what wets some parts when they are used for a vessel."""
    if making.meetings.keeps_apart(vessel):
        return False
    met, most, own = making.meetings.of(vessel), FILM_NL * len(parts), (reagent, False)
    return reagent in making.unwelcome or any(
        making.meetings.is_pair(lot, own) and met.get((lot, own), 0) < most
        for lot in most_of(making.matter.held(vessel))
    )
