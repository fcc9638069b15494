"""What the vessels of a rig say that is in them, by label or by contents."""

from __future__ import annotations

from difflib import get_close_matches

from labweb.domain.recipes.on_rig.equipment import Equipment, VesselSort

LISTED = 8
"""Most that a message lists."""

_ALIKE = 0.8
"""How much alike two labels are that one may be written for the other; 1: letter by letter."""


def held(equipment: Equipment, key: str) -> set[str]:
    """Return what a vessel is labelled with, or else the names of what is in it."""
    named = equipment.chemical(key)
    return {named} if named else {name for name, _ in equipment.contents(key)}


def alike(name: str, equipment: Equipment) -> dict[str, str]:
    """Return flasks whose label looks like a reagent, with the label: for a person to choose."""
    labels: dict[str, list[tuple[str, str]]] = {}
    for key, sort in equipment.vessels.items():
        if sort in (VesselSort.FLASK, VesselSort.PLAIN):
            for label in held(equipment, key):
                labels.setdefault(label.casefold(), []).append((key, label))
    near = get_close_matches(name[:80].casefold(), labels, n=1, cutoff=_ALIKE)
    return dict(labels[near[0]][:LISTED]) if near else {}
