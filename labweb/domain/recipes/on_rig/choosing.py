"""Which vessel takes what nobody names one for: a waste by its chemistry, an empty flask."""

from __future__ import annotations

from labweb.domain.recipes.on_rig.equipment import VesselSort
from labweb.domain.recipes.on_rig.making import Making
from labweb.domain.recipes.on_rig.wastes import choose_waste
from labweb.domain.recipes.on_rig.ways import chain_of
from labweb.domain.recipes.xdl.expansion.basic_operations import BUFFER, KEPT, WASTE
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace


def choose_buffer(making: Making, source: str, place: FilePlace, waits_in: str = "") -> str | None:
    """Choose an empty vessel that gives back what it is given; None: there is none, as is told.

    The vessel that the recipe names for what waits comes first, then the nearest spare flask; one
    that holds all that may have to wait before one that does not.
    """
    equipment = making.equipment
    busy = {*making.binding.vessels.values(), *making.binding.flasks(), source}
    busy |= {*making.buffers, *making.kept}
    wanted = making.binding.vessels.get(waits_in)
    waiting_nl = making.matter.liquid(source).most
    found = []
    for key, sort in equipment.vessels.items():
        is_spare = sort is VesselSort.FLASK and not equipment.chemical(key) and key not in busy
        is_spare = is_spare and not equipment.is_receiver(key)
        is_own = key == wanted and sort is not VesselSort.WASTE and key != source
        if making.matter.liquid(key).most or not (is_spare or is_own):
            continue
        there, back = chain_of(making, source, key), chain_of(making, key, source)
        if there is not None and back is not None:
            capacity = making.capacity_nl(key)
            is_small = capacity is not None and capacity < waiting_nl
            found.append((is_small, not is_own, len(there.pumps), key))
    if not found:
        message = f"{source} reaches no empty flask that gives back what it is given"
        making.told.tell("plan.no_buffer", message, place, vessel=source)
        return None
    return min(found)[-1]


def resolve(
    making: Making, name: str, source: str, place: FilePlace, waits_in: str = ""
) -> str | None:
    """Return the vessel behind the name of a target, which may be a waste or a buffer."""
    found = _resolve(making, name, source, place, waits_in)
    if found is not None and name in (WASTE, BUFFER, KEPT):
        at = {"line": place.line, "column": place.column} if place.line else {}
        making.chosen.append({"stands_for": name, "key": found, **at})
    return found


def _resolve(making: Making, name: str, source: str, place: FilePlace, waits_in: str) -> str | None:
    if name == WASTE:
        return choose_waste(making, source, place)
    if name == BUFFER:
        found = choose_buffer(making, source, place, waits_in)
        making.buffers += [found] if found else []
        return found
    if name == KEPT:
        if not making.kept:
            found = choose_buffer(making, source, place)
            making.kept += [found] if found else []
        return making.kept[0] if making.kept else None
    return making.bound(name, place)
