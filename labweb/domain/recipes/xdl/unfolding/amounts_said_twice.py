"""What a step says in two ways: an amount by mass and volume, a rate by time and speed.

Where the two agree, one is enough; where they differ, nobody can tell which counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal

from labweb.domain.errors import UnitError
from labweb.domain.recipes.xdl.file_format.attribute_values import (
    Value,
    XdlQuantity,
    unit_of,
    written,
)
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.file_format.recipe_model import Reagent
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace
from labweb.domain.recipes.xdl.unfolding.reagent_amounts import Scale, to_dispense

ALIKE = Decimal("0.01")
"""Part of the larger by which two may differ: what people write is rounded."""

_OTHERS = (("Add", "volume", "mass"), ("AddSolid", "mass", "mol"))


def without_second_amount(
    step: str, values: dict[str, Value], reagent: Reagent | None, place: FilePlace, told: Findings
) -> dict[str, Value]:
    """Leave out an amount that says the same as the one that counts; tell of one that does not.

    What cannot be compared, for the reagent lacks density or molar mass, stays: no operation does
    it, and a note of the plan says so.
    """
    for name, counts, other in _OTHERS:
        one, two = values.get(counts), values.get(other)
        if step != name or not isinstance(one, XdlQuantity) or not isinstance(two, XdlQuantity):
            continue
        measured = _measured(step, two, reagent)
        if one.exact is None or measured is None:
            continue
        if not are_alike(one.exact, measured):
            message = (
                f"{step} says {written(one)} and {written(two)}, which would be {measured:.4g} "
                f"{unit_of(one.sort)}: which of them counts?"
            )
            told.tell("xdl.two_amounts", message, place)
        return {key: value for key, value in values.items() if key != other}
    return values


def _measured(step: str, amount: XdlQuantity, reagent: Reagent | None) -> Decimal | None:
    if reagent is None:
        return None
    is_solid = step == "AddSolid" or reagent.is_solid
    facts = Reagent(id=reagent.id, name=reagent.name, values={**reagent.values, "solid": is_solid})
    try:
        found = to_dispense(amount, facts, Scale())
    except UnitError:
        return None
    return found.exact if found.sort != amount.sort else None


def rate_of(
    step: str, said: Mapping[str, Decimal], place: FilePlace, told: Findings
) -> Decimal | None:
    """Return how fast a step pushes its liquid, of all that it says of it; None: nothing.

    A rate of nothing is told, and so are two that differ by more than people round.
    """
    if not said:
        return None
    if min(said.values()) <= 0:
        message = f"{step} is to move its liquid at a rate of 0: say a time or a speed"
        told.tell("unit.not_positive", message, place)
    elif not are_alike(min(said.values()), max(said.values())):
        ways = " and ".join(f"{rate:.4g} µL/s by its {name}" for name, rate in said.items())
        message = f"{step} is to move its liquid at {ways}: these differ, so leave one out"
        told.tell("xdl.two_rates", message, place)
    return next(iter(said.values()))


def are_alike(one: Decimal, other: Decimal) -> bool:
    """Tell whether two numbers are the same but for rounding."""
    return abs(one - other) <= ALIKE * max(abs(one), abs(other))
