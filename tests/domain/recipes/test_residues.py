"""What a step leaves on a valve, and what it finds there when it comes over it again.

Rig of `test_wastes`: from the reactor to the separator liquid goes over each valve twice.
"""

from __future__ import annotations

from typing import Any

from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.domain.recipes.plans import claims, compiled, unproved
from tests.domain.recipes.rigs import rig_of
from tests.domain.recipes.test_films import CYANIDE, some
from tests.domain.recipes.test_wastes import GROUPS, text, two_wastes

MOVED = 'Transfer from_vessel="reactor" to_vessel="separator" volume="all"'
TRACED = (some("acid", 5, "reactor"), some("base", 0.1, "reactor"), MOVED)
"""The acid was with less of the base than a valve keeps."""


def residues(plan: dict[str, Any]) -> list[str]:
    told = unproved(plan | {"groups": CYANIDE, "keeps_apart": True}, rig_of(two_wastes({})))
    return [one.message for one in told if one.code == "interpret.residue"]


def joined(plan: dict[str, Any]) -> dict[str, Any]:
    """Let the last step do what the one before it did as well."""
    *steps, first, last = plan["steps"]
    both = {**last, "id": first["id"], "after": first["after"]}
    both["actions"] = [*first["actions"], *last["actions"]]
    return plan | {"steps": [*steps, both], "totals": {}}


def test_a_mixture_that_crosses_a_valve_twice_finds_no_residue_of_itself() -> None:
    plan = compiled(text(*TRACED), two_wastes({}), CompileWish(groups=GROUPS, rinse=("water",)))
    assert claims(plan)[-1]["all"] is True
    assert residues(plan) == []


def test_what_an_earlier_step_left_on_a_valve_is_found_by_the_same_mixture() -> None:
    found = residues(compiled(text(*TRACED), two_wastes({})))
    assert any("acid meets base" in message and "valve_1" in message for message in found)


def test_what_another_liquid_of_the_same_step_left_on_a_valve_is_found() -> None:
    steps = (some("acid", 5, "reactor"), some("dcm", 5))
    assert residues(joined(compiled(text(*steps), two_wastes({}))))
    washed = (steps[0], some("water", 9, "reactor"), steps[1])
    assert residues(joined(compiled(text(*washed), two_wastes({})))) == []
