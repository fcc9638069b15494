"""What wets syringes and valves is not carried onto what it must not meet in a vessel.

Rig of `test_wastes`: acid is in the separator, then something that must not meet it goes over the
same syringe into the reactor, and water, which may meet both, follows into the separator.
"""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.domain.recipes.plans import claims, compiled, unproved
from tests.domain.recipes.rigs import rig_of
from tests.domain.recipes.test_rinses import add, rinses
from tests.domain.recipes.test_wastes import GROUPS, refused, text, two_wastes

CYANIDE = {**GROUPS, "dcm": ["cyanide"]}
DILUTED = (add("acid", "separator"), 'Add vessel="separator" reagent="water" volume="20 mL"')
STEPS = (*DILUTED, add("dcm"), add("water", "separator"))


def some(name: str, ml: float, vessel: str = "separator") -> str:
    return f'Add vessel="{vessel}" reagent="{name}" volume="{ml} mL"'


def pushed(*, is_wet: bool) -> tuple[dict[str, Any], str]:
    """Let argon push the last delivery out of a tube over a syringe that the delivery misses."""
    graph = two_wastes({})
    next(n for n in graph["nodes"] if n["id"] == "flask_spare")["chemical"] = "argon"
    for link in graph["links"]:
        if "reactor" in (link["source"], link["target"]):
            link["volume"] = 0.5
    wetting = (add("base", "separator"),) if is_wet else ()
    return graph, text(*wetting, add("acid"))


def test_what_wets_the_lines_is_rinsed_out_before_water_carries_it_onto_its_enemy() -> None:
    plan = compiled(
        text(*STEPS), two_wastes({}), CompileWish(groups=CYANIDE, rinse=("acetone", "water"))
    )
    kinds = [(does["kind"], does.get("lot")) for does in claims(plan, "transfer", "clean")]
    after = kinds[kinds.index(("transfer", "dcm")) + 1 :]
    assert after[:3] == [("clean", "acetone")] * 3
    assert after[-1] == ("transfer", "water")


def test_without_a_solvent_for_rinsing_it_is_refused_with_what_would_help() -> None:
    for wish in (CompileWish(groups=CYANIDE), CompileWish(groups=CYANIDE, rinse=("acid",))):
        found = refused(text(*STEPS), two_wastes({}), wish)
        assert [one.code for one in found] == ["plan.no_rinse"]
        assert "wet with dcm" in found[0].message
        assert "in separator" in found[0].message
        assert "--rinse" in found[0].message


def test_the_verifier_sees_what_is_carried_by_itself() -> None:
    plan = compiled(text(*STEPS), two_wastes({})) | {"groups": CYANIDE, "keeps_apart": True}
    found = unproved(plan, rig_of(two_wastes({})))
    assert [one.code for one in found] == ["interpret.incompatible"]
    assert "dcm, which wets the lines, meets acid" in found[0].message


@pytest.mark.parametrize(
    "steps",
    [
        (*DILUTED, some("dcm", 0.1), add("water", "separator")),
        (*DILUTED, some("dcm", 5), add("water", "separator")),
        (add("dcm"), add("water", "separator")),
        (*DILUTED, add("dcm"), some("acetone", 9, "reactor"), add("water", "separator")),
    ],
)
def test_where_the_recipe_brings_them_together_or_nothing_is_left_nothing_is_rinsed(
    steps: tuple[str, ...],
) -> None:
    plan = compiled(text(*steps), two_wastes({}), CompileWish(groups=CYANIDE))
    assert rinses(plan) == []
    assert plan["steps"] == compiled(text(*steps), two_wastes({}))["steps"]


def test_a_trace_that_the_recipe_brings_there_does_not_free_what_wets_the_lines() -> None:
    more = (some("dcm", 0.1), add("dcm"), add("water", "separator"))
    found = refused(text(*DILUTED, *more), two_wastes({}), CompileWish(groups=CYANIDE))
    assert [one.code for one in found] == ["plan.no_rinse"]
    plan = compiled(text(*DILUTED, *more), two_wastes({}))
    told = unproved(plan | {"groups": CYANIDE, "keeps_apart": True}, rig_of(two_wastes({})))
    assert [one.code for one in told] == ["interpret.incompatible"]


def test_a_rinse_leaves_no_solvent_in_the_lines_that_must_not_come_into_the_vessel() -> None:
    groups = {"acid": ["water_reactive"], "water": ["water"], "dcm": ["halogenated"]}
    steps = text(add("acid"), add("base", "separator"), add("dcm"))
    plan = compiled(steps, two_wastes({}), CompileWish(groups=groups, rinse=("water",)))
    assert claims(plan)[-1]["lot"] == "dcm"
    assert claims(plan)[-2]["kind"] == "transfer"


def test_gas_pushes_nothing_onto_its_enemy_that_wets_another_syringe() -> None:
    graph, steps = pushed(is_wet=True)
    groups = {"acid": ["acid"], "base": ["cyanide"], "water": ["water"]}
    found = refused(steps, graph, CompileWish(groups=groups, primes=True))
    assert "plan.no_rinse" in {one.code for one in found}
    plan = compiled(steps, graph, CompileWish(groups=groups, rinse=("water",), primes=True))
    kinds = [does["kind"] for does in claims(plan)]
    assert kinds[-1] == "push"
    assert kinds[-2] == "clean"
    free = compiled(steps, graph, CompileWish(primes=True))
    told = unproved(free | {"groups": groups, "keeps_apart": True}, rig_of(graph))
    assert {one.code for one in told} == {"interpret.incompatible"}
    graph, steps = pushed(is_wet=False)
    assert rinses(compiled(steps, graph, CompileWish(groups=groups, primes=True))) == []


def test_parted_phases_carry_nothing_onto_its_enemy_either() -> None:
    parts = (
        'SeparatePhases separation_vessel="separator" lower_phase_vessel="reactor" '
        'upper_phase_vessel="waste_aqueous"'
    )
    steps = text(add("acid"), add("water", "separator"), some("dcm", 1, "filter"), parts)
    graph = two_wastes({})
    graph["nodes"] = [
        {**n, "id": "filter", "class": "ChemputerFilter"} if n["id"] == "flask_spare" else n
        for n in graph["nodes"]
    ]
    for link in graph["links"]:
        for end in ("source", "target"):
            if link[end] == "flask_spare":
                link[end], link["port"] = "filter", link["port"].replace(",0", ",top")
    graph["links"] = [one for one in graph["links"] if one["source"] != "filter"]
    found = refused(steps, graph, CompileWish(groups=CYANIDE))
    assert {one.code for one in found} == {"plan.no_rinse"}
    plan = compiled(steps, graph, CompileWish(groups=CYANIDE, rinse=("acetone",)))
    assert claims(plan)[-1]["kind"] == "separate"
    assert claims(plan)[-2]["kind"] == "clean"


THEN_WATER = (add("dcm"), some("water", 20))
TO_WASTE = 'Transfer from_vessel="{}" to_vessel="waste_organic" volume="all"'
AS_WELL = 'Transfer from_vessel="dcm" to_vessel="waste_organic" volume="5 mL"'
CARRIED_ON = 'Transfer from_vessel="separator" to_vessel="reactor" volume="all"'
LATER = (
    (*THEN_WATER, add("acid", "separator")),
    (AS_WELL, some("water", 20), add("acid"), CARRIED_ON),
    (*THEN_WATER, some("dcm", 0.1), some("water", 20), add("acid", "separator")),
)
"""What wets the lines comes with water into a vessel; its enemy follows, or is where it goes on."""


@pytest.mark.parametrize("steps", LATER)
def test_what_lines_have_brought_is_weighed_against_what_comes_later(
    steps: tuple[str, ...],
) -> None:
    graph = two_wastes({})
    found = refused(text(*steps), graph, CompileWish(groups=CYANIDE))
    assert {one.code for one in found} == {"plan.no_rinse"}
    assert "dcm" in found[0].message
    assert "--rinse" in found[0].message
    told = unproved(
        compiled(text(*steps), graph) | {"groups": CYANIDE, "keeps_apart": True}, rig_of(graph)
    )
    assert {one.code for one in told} == {"interpret.incompatible"}


def test_it_is_rinsed_out_before_it_gets_there() -> None:
    wish = CompileWish(groups=CYANIDE, rinse=("acetone",))
    plan = compiled(text(*LATER[0]), two_wastes({}), wish)
    order = [(does["kind"], does.get("lot")) for does in claims(plan, "transfer", "clean")]
    assert order[order.index(("transfer", "dcm")) + 1 :][:3] == [("clean", "acetone")] * 3
    plan = compiled(text(*LATER[1]), two_wastes({}), wish)
    assert claims(plan)[-1]["to"] == "reactor"


@pytest.mark.parametrize(
    "steps",
    [
        (*THEN_WATER, TO_WASTE.format("separator"), add("acid", "separator")),
        (*THEN_WATER, some("dcm", 5), add("acid", "separator")),
        (*THEN_WATER, add("base", "separator")),
        (*THEN_WATER, CARRIED_ON),
    ],
)
def test_what_has_left_the_vessel_or_was_brought_there_by_the_recipe_hinders_nothing(
    steps: tuple[str, ...],
) -> None:
    assert rinses(compiled(text(*steps), two_wastes({}), CompileWish(groups=CYANIDE))) == []


def test_a_solid_that_comes_by_hand_finds_what_lines_have_brought() -> None:
    steps = text(*THEN_WATER, 'AddSolid vessel="separator" reagent="acid" mass="1 g"')
    found = refused(steps, two_wastes({}), CompileWish(groups=CYANIDE))
    assert [one.code for one in found] == ["plan.no_rinse"]
    assert compiled(steps, two_wastes({}), CompileWish(groups=CYANIDE, rinse=("acetone",)))
