"""What a graph says of the matter in its vessels: words at wastes, and of what type they are."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.domain.recipes.plans import claims, compiled, unproved
from tests.domain.recipes.rigs import rig_of
from tests.domain.recipes.test_wastes import GROUPS, refused, text, two_wastes

POURED = text('Transfer from_vessel="acid" to_vessel="waste_aqueous" volume="5 mL"')
WISH = CompileWish(groups=GROUPS)


def rig(**at_waste: object) -> dict[str, Any]:
    graph = two_wastes({})
    next(n for n in graph["nodes"] if n["id"] == "waste_aqueous").update(at_waste)
    return graph


def held(**more: object) -> dict[str, Any]:
    return rig(chemical="NaCN", current_volume=50, **more)


def test_acid_is_not_poured_onto_what_a_waste_says_is_in_it() -> None:
    found = refused(POURED, held(groups=["cyanide"]), WISH)
    assert [one.code for one in found] == ["plan.incompatible"]
    assert "NaCN" in found[0].message


def test_what_is_in_a_waste_may_be_declared_by_its_name() -> None:
    wish = CompileWish(groups={**GROUPS, "NaCN": ["cyanide"]})
    assert [one.code for one in refused(POURED, held(), wish)] == ["plan.incompatible"]


def test_the_verifier_reads_what_a_waste_says_by_itself() -> None:
    plan = compiled(POURED, held(), WISH)
    told = unproved(plan, rig_of(held(groups=["cyanide"])))
    assert {one.code for one in told} == {"interpret.chemistry"}
    assert "NaCN is cyanide" in told[0].message
    plan["contents"] = {}
    told = unproved(plan, rig_of(held(groups=["cyanide"])))
    assert "waste_aqueous holds something" in told[0].message


def test_words_at_a_vessel_of_several_lots_are_of_none_until_they_are_declared() -> None:
    graph = held(groups=["salt"])
    both = {"waste_aqueous": {"water": 1_000_000}}
    found = refused(POURED, graph, CompileWish(groups=GROUPS, holds_nl=both))
    assert [one.code for one in found] == ["plan.unknown_chemistry"]
    assert "NaCN, water" in found[0].message
    known = {**GROUPS, "NaCN": ["salt"]}
    plan = compiled(POURED, graph, CompileWish(groups=known, holds_nl=both))
    assert plan["groups"]["NaCN"] == ["salt"]


@pytest.mark.parametrize("name", ["groups", "takes"])
@pytest.mark.parametrize("value", [{"acid": True}, 5, [["acid"]], ["acid", 3], ",", False])
def test_what_are_no_words_is_told_by_planner_and_verifier(name: str, value: object) -> None:
    graph = rig(**{name: value})
    found = refused(POURED, graph, WISH)
    assert ("plan.unknown_group", "waste_aqueous") in {(one.code, one.subject) for one in found}
    plan = compiled(POURED, rig(), WISH)
    told = unproved(plan, rig_of(graph))
    assert ("interpret.chemistry", "waste_aqueous") in {(one.code, one.subject) for one in told}


def test_an_empty_list_says_that_a_waste_takes_no_stream_and_an_empty_text_says_nothing() -> None:
    for value in ([], [""]):
        assert [one.code for one in refused(POURED, rig(takes=value), WISH)] == ["plan.no_stream"]
        told = unproved(compiled(POURED, rig(), WISH), rig_of(rig(takes=value)))
        assert {one.code for one in told} == {"interpret.waste"}
    for nothing in ("", " ", None):
        assert claims(compiled(POURED, rig(takes=nothing), WISH), "transfer")
