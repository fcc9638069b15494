"""What is in the vessels before the first step, by the graph and by whoever asks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from labweb.domain.errors import Finding
from labweb.domain.recipes.on_rig.binding import RigBinding
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.on_rig.making import Making
from labweb.domain.recipes.on_rig.matter import exactly
from labweb.domain.units import render_volume

Held = Mapping[str, Mapping[str, int]]
"""Vessel → what a person says is in it → nanolitres."""


def charge(making: Making, held_nl: Held) -> None:
    """Put into the vessels what the graph and whoever asks say is in them."""
    for key in making.equipment.vessels:
        for lot, amount in _stated(making.equipment, making.binding, key, held_nl):
            making.bring(key, {(lot, False): exactly(amount)})


def check_charge(equipment: Equipment, binding: RigBinding, held_nl: Held) -> Iterator[Finding]:
    """Yield a finding for each vessel that cannot hold what is said to be in it.

    There is no such vessel, it is smaller, less than nothing is in it, or a flask that a reagent
    comes out of holds another lot as well.
    """
    for key in held_nl:
        if key not in equipment.vessels:
            yield Finding("plan.unknown_vessel", f"{key!r} is no vessel of the graph", key)
    for key in sorted(equipment.rig.pumps):
        held = equipment.contents(key)
        if held:
            message = (
                f"{key} is said to hold {render_volume(sum(amount for _, amount in held))}, and a "
                "plan begins with empty syringes: empty it, or correct what is stated"
            )
            yield Finding("plan.syringe_not_empty", message, key)
    for key in equipment.vessels:
        stated = list(_stated(equipment, binding, key, held_nl))
        total, capacity = sum(amount for _, amount in stated), equipment.capacity_nl(key)
        if any(amount < 0 for _, amount in stated):
            message = f"less than nothing is said to be in {key} before the first step"
            yield Finding("unit.not_positive", message, key)
        elif capacity is not None and total > capacity:
            message = (
                f"{key} holds {render_volume(capacity)}, and {render_volume(total)} is said to be "
                "in it before the first step: correct what is stated"
            )
            yield Finding("plan.stated_overfull", message, key, {"vessel": key})
        reagent = _reagent(binding, key)
        others = sorted({lot for lot, amount in stated if amount} - {reagent})
        if reagent and others:
            message = (
                f"{reagent} comes out of {key}, in which {', '.join(others)} is said to be as "
                "well: a flask holds one reagent"
            )
            yield Finding("plan.mixed_flask", message, key, {"vessel": key, "lots": others})


def _stated(
    equipment: Equipment, binding: RigBinding, key: str, held_nl: Held
) -> Iterator[tuple[str, int]]:
    lot = _reagent(binding, key)
    yield from ((lot or name, amount) for name, amount in equipment.contents(key))
    yield from held_nl.get(key, {}).items()


def _reagent(binding: RigBinding, key: str) -> str:
    """Return the reagent that comes out of a vessel, "" where none does."""
    return next((name for name, keys in binding.reagents.items() if key in keys), "")
