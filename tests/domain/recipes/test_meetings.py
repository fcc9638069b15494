"""How much of two liquids that must not meet has met, and where they may then come together.

Rigs of `test_wastes`; the starter lab where materials list what they must not meet.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL, AmountRange, Contents
from labweb.domain.proof.unplanned_mixing import Encounters, Gift
from labweb.domain.proof.wetted_lines import Lines
from labweb.domain.recipes.on_rig.matter import exactly
from labweb.domain.recipes.on_rig.meetings import Meetings, Pour, kept_of
from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.domain.recipes.plans import claims, compiled, recipe, unproved
from tests.domain.recipes.rigs import rig_of
from tests.domain.recipes.test_rinses import add, rinses
from tests.domain.recipes.test_wastes import BOTH, GROUPS, clean, refused, text, two_wastes
from tests.domain.recipes.test_wastes import stirred as with_stirrer

WISH = CompileWish(groups=GROUPS, rinse=("water",))
TO_WASTE = 'Transfer from_vessel="{}" to_vessel="waste_aqueous" volume="{}"'
UL = 1000 * UNITS_PER_NL
STARTER = Path(__file__).parents[3] / "fixtures/labs/starter/lab.json"


def acid_with(base_ml: float) -> tuple[str, ...]:
    """Bring a base onto an acid in the reactor, after a base went into the aqueous waste."""
    both = (
        'Add vessel="reactor" reagent="acid" volume="10 mL"',
        f'Add vessel="reactor" reagent="base" volume="{base_ml} mL"',
    )
    return (clean("base"), *both, TO_WASTE.format("reactor", "all"))


def test_an_acid_that_met_a_trace_of_base_goes_onto_no_base() -> None:
    graph = with_stirrer(two_wastes(BOTH))
    plan = compiled(text(*acid_with(10)), graph, WISH)
    assert claims(plan, "transfer")[-1]["to"] == "waste_aqueous"
    for base_ml in (0.1, 9.9):
        found = refused(text(*acid_with(base_ml)), graph, WISH)
        assert {one.code for one in found} == {"plan.incompatible"}
        assert "brought as much of the two together" in found[0].message


Poured = tuple[dict[str, int], dict[tuple[str, str], int]]
"""Microlitres of each lot, and how much of another lot each has met."""

NEUTRAL: Poured = ({"acid": 10, "base": 10}, {("acid", "base"): 10, ("base", "acid"): 10})
TRACED: Poured = ({"acid": 10, "base": 1}, {("acid", "base"): 1, ("base", "acid"): 10})
ACID: Poured = ({"acid": 10}, {})
BASE: Poured = ({"base": 10}, {})
CASES: tuple[tuple[tuple[Poured, ...], Poured, bool], ...] = (
    ((), ACID, True),
    ((ACID,), BASE, False),
    ((ACID,), NEUTRAL, True),
    ((NEUTRAL,), BASE, True),
    ((NEUTRAL, BASE), BASE, False),
    ((ACID, ACID), NEUTRAL, False),
    ((NEUTRAL, NEUTRAL), NEUTRAL, True),
    ((BASE,), TRACED, False),
    ((ACID,), TRACED, True),
    ((TRACED,), BASE, False),
    ((TRACED,), ({"base": 1}, {}), True),
    ((TRACED,), ({"acid": 1, "base": 10}, {("acid", "base"): 10, ("base", "acid"): 1}), False),
    ((({"water": 10}, {}),), ACID, True),
)


@pytest.mark.parametrize(("there", "coming", "may"), CASES)
def test_planner_and_verifier_weigh_alike_what_has_met(
    there: tuple[Poured, ...], coming: Poured, may: bool
) -> None:
    planner = Meetings([frozenset(("acid", "base"))], ["waste"])
    verifier = Encounters({frozenset(("acid", "base")): "heat"})

    def gifts(amounts: dict[str, int], met: dict[tuple[str, str], int]) -> list[Gift]:
        return [
            Gift(
                (lot, False),
                n * UL,
                {(two[1], False): much * UL for two, much in met.items() if two[0] == lot},
            )
            for lot, n in amounts.items()
        ]

    def pour(amounts: dict[str, int], met: dict[tuple[str, str], int]) -> Pour:
        pairs = {((one, False), (two, False)): much for (one, two), much in met.items()}
        return Pour({(lot, False): n for lot, n in amounts.items()}, pairs)

    for poured in there:
        planner.pour("waste", pour(*poured))
        verifier.give("waste", gifts(*poured))
    assert (planner.first("waste", pour(*coming)) is None) is may
    assert (not list(verifier.find("waste", gifts(*coming)))) is may


SOLID_BASE = (
    'AddSolid vessel="separator" reagent="base" mass="2 g"',
    'Add vessel="separator" reagent="water" volume="5 mL"',
)
LIQUID_BASE = ('Add vessel="separator" reagent="base" volume="2 mL"',)


def test_what_met_a_lot_as_a_liquid_may_not_meet_it_as_a_solid() -> None:
    graph = with_stirrer(two_wastes({}))
    for base, may in ((LIQUID_BASE, True), (SOLID_BASE, False)):
        steps = text(*base, TO_WASTE.format("separator", "all"), *acid_with(10)[1:])
        plan = compiled(steps, graph) | {"groups": GROUPS, "keeps_apart": True}
        told = {one.code for one in unproved(plan, rig_of(graph))} - {"interpret.residue"}
        assert told == (set() if may else {"interpret.incompatible"})
        if may:
            assert compiled(steps, graph, WISH)
        else:
            assert {one.code for one in refused(steps, graph, WISH)} == {"plan.incompatible"}


@pytest.mark.parametrize(
    ("water_ul", "left_ug"), [(5000, 1_200_000), (30_000, 200_000), (200, 20_000_000)]
)
def test_of_a_solid_lines_keep_as_much_as_is_in_what_they_keep(water_ul: int, left_ug: int) -> None:
    portion = {("base", True): exactly(20_000_000), ("water", False): exactly(1000 * water_ul)}
    assert kept_of(portion) == {("base", True): left_ug, ("water", False): 300_000}
    water, base = AmountRange.exactly(water_ul * UL), AmountRange.exactly(20_000_000 * UNITS_PER_NL)
    lines = Lines()
    lines.wet("valve_1", "reactor", Contents({"water": water}, {"base": base}, water))
    assert lines.amounts_on("valve_1") == {
        ("base", True): left_ug * UNITS_PER_NL,
        ("water", False): 300 * UL,
    }


def test_the_verifier_weighs_what_has_met_by_itself() -> None:
    graph = with_stirrer(two_wastes({}))
    for base_ml, told in ((10, set()), (0.1, {"interpret.incompatible"})):
        plan = compiled(text(*acid_with(base_ml)), graph)
        plan |= {"groups": GROUPS, "keeps_apart": True}
        found = {one.code for one in unproved(plan, rig_of(graph))} - {"interpret.residue"}
        assert found == told


def holding_cyanide() -> dict[str, Any]:
    graph = two_wastes({})
    for node in graph["nodes"]:
        if node["id"].startswith("waste"):
            node.update(chemical="NaCN", current_volume=50)
        if node["id"] == "waste_aqueous":
            node["groups"] = ["cyanide"]
    return graph


def test_what_wets_the_lines_goes_into_no_waste_with_another_liquid_either() -> None:
    steps = (add("acid", "separator"), TO_WASTE.format("dcm", "5 mL"))
    wish = CompileWish(groups={**GROUPS, "NaCN": ["cyanide"]})
    found = refused(text(*steps), holding_cyanide(), wish)
    assert [one.code for one in found] == ["plan.incompatible"]
    assert "what wets the lines to waste_aqueous: acid" in found[0].message
    graph = two_wastes({})
    next(n for n in graph["nodes"] if n["id"] == "waste_aqueous").update(
        chemical="NaCN", current_volume=50, groups=["cyanide"]
    )
    plan = compiled(text(*steps), graph, CompileWish(groups=GROUPS, rinse=("water",)))
    assert set(rinses(plan)) == {("water", "waste_organic")}


def test_the_verifier_counts_what_wets_the_lines_into_a_waste() -> None:
    steps = (add("acid", "separator"), TO_WASTE.format("dcm", "5 mL"))
    graph = two_wastes({})
    next(n for n in graph["nodes"] if n["id"] == "waste_aqueous").update(
        chemical="NaCN", current_volume=50
    )
    plan = compiled(text(*steps), graph)
    plan |= {"groups": {"acid": ["acid"], "NaCN": ["cyanide"]}, "keeps_apart": True}
    found = unproved(plan, rig_of(graph))
    assert [one.code for one in found] == ["interpret.incompatible"]
    assert "acid meets NaCN" in found[0].message


def test_what_a_rinse_left_in_a_waste_is_known_when_another_liquid_comes() -> None:
    steps = (add("acid"), 'ResetHandling solvent="water" volume="20 mL"')
    graph = two_wastes({"waste_aqueous": ["aqueous", "acid", "base", "cyanide"]})
    groups = {**GROUPS, "base": ["cyanide"]}
    poured = TO_WASTE.format("base", "5 mL")
    assert compiled(text(*steps), graph, CompileWish(groups=groups))
    found = refused(text(*steps, poured), graph, CompileWish(groups=groups))
    assert [one.code for one in found] == ["plan.incompatible"]
    plan = compiled(text(*steps, poured), graph, CompileWish(groups=GROUPS | {"base": ["water"]}))
    plan["groups"] = groups
    assert {one.code for one in unproved(plan, rig_of(graph))} >= {"interpret.incompatible"}


def test_groups_at_a_waste_in_which_nothing_is_are_told() -> None:
    graph = two_wastes({})
    next(n for n in graph["nodes"] if n["id"] == "waste_aqueous")["groups"] = ["cyanide"]
    found = refused(text(add("acid")), graph, CompileWish(groups=GROUPS))
    assert [(one.code, one.subject) for one in found] == [
        ("plan.unknown_chemistry", "waste_aqueous")
    ]
    plan = compiled(text(add("acid")), two_wastes({}), CompileWish(groups=GROUPS))
    told = unproved(plan, rig_of(graph))
    assert [one.code for one in told] == ["interpret.chemistry"]
    assert "waste_aqueous" in told[0].message


def test_what_is_together_in_a_vessel_from_the_start_has_met() -> None:
    held = {"reactor": {"acid": 10**7, "base": 10**7}}
    steps = (TO_WASTE.format("reactor", "5 mL"),) * 2
    plan = compiled(text(*steps), two_wastes({}), CompileWish(groups=GROUPS, holds_nl=held))
    assert [does["to"] for does in claims(plan, "transfer")] == ["waste_aqueous"] * 2


@pytest.mark.parametrize("is_first", [True, False])
def test_what_was_left_in_a_vessel_meets_nothing_in_another_either(*, is_first: bool) -> None:
    graph = two_wastes({})
    next(n for n in graph["nodes"] if n["id"] == "reactor").update(
        chemical="NaCN", current_volume=50
    )
    moved = 'Transfer from_vessel="reactor" to_vessel="separator" volume="all"'
    steps = (moved, add("acid", "separator"))
    steps = steps if is_first else steps[::-1]
    groups = {**GROUPS, "NaCN": ["cyanide"]}
    found = refused(text(*steps), graph, CompileWish(groups=groups, rinse=("water",)))
    assert [one.code for one in found] == ["plan.incompatible"]
    plan = compiled(text(*steps), graph, CompileWish(groups=GROUPS, rinse=("water",)))
    plan |= {"groups": groups, "keeps_apart": True}
    told = [one for one in unproved(plan, rig_of(graph)) if one.code == "interpret.incompatible"]
    assert ["one of them was left" in one.message for one in told] == [True]


POURS = (
    'Add vessel="reactor_1" reagent="acid" volume="5 mL"',
    'Transfer from_vessel="reactor_1" to_vessel="waste" volume="all"',
)
VESSELS = ("reactor_1", "flask_1", "flask_2")


def starter(avoids: list[str], reactor: str = "") -> dict[str, Any]:
    lab: dict[str, Any] = json.loads(STARTER.read_text("utf-8"))
    material = next(one for one in lab["materials"] if one["key"].startswith("hydrochloric"))
    material["incompatible_with"] = avoids
    dye = next(one for one in lab["materials"] if one["key"] == "dye")
    dye["groups"] = ["our_own_word"]
    if reactor:
        vessel = next(one for one in lab["resources"] if one["key"] == "reactor_1")
        vessel["contents"] = [{"lot": reactor, "amount_ul": 5000}]
    return lab


def asked(*steps: str) -> tuple[str, CompileWish]:
    hardware = "".join(f'<Component id="{key}" type="flask"/>' for key in (*VESSELS, "waste"))
    reagents = ("acid", "dye", "water")
    wish = CompileWish(bind={name: name for name in (*VESSELS, *reagents)})
    return recipe(*steps, hardware=hardware, reagents=reagents), wish


@pytest.mark.parametrize("avoids", ["dye", "our_own_word"])
def test_what_the_lab_lists_as_incompatible_does_not_meet(avoids: str) -> None:
    dye = tuple(step.replace('"acid"', '"dye"').replace("reactor_1", "flask_1") for step in POURS)
    over_one_pump = (
        POURS[0].replace("reactor_1", "flask_1"),
        'Transfer from_vessel="flask_1" to_vessel="flask_2" volume="all"',
        dye[0].replace("flask_1", "reactor_1"),
    )
    cases = (
        ((*POURS, *dye), "incompatible", starter([avoids])),
        (over_one_pump, "no_rinse", starter([avoids])),
        ((POURS[0],), "incompatible", starter([avoids], "dye_lot")),
    )
    for steps, code, lab in cases:
        said, wish = asked(*steps)
        found = refused(said, lab, wish)
        assert [one.code for one in found] == [f"plan.{code}"]
        assert any("incompatible_with" in one.message for one in found)
        free = {**lab, "materials": [dict(one, incompatible_with=[]) for one in lab["materials"]]}
        plan = compiled(said, free, wish) | {"keeps_apart": True}
        told = {one.code for one in unproved(plan, rig_of(lab))}
        verified = {"no_rinse": "residue"}.get(code, code)
        assert told == {f"interpret.{verified}"}


def test_the_recipe_itself_may_bring_together_what_the_lab_keeps_apart() -> None:
    said, wish = asked(POURS[0], POURS[0].replace('"acid"', '"dye"'))
    assert compiled(said, starter(["dye"]), wish)
