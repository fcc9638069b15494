"""Which waste takes what, on a rig with two of them.

    flask_water, flask_dcm, flask_acid, flask_acetone ▸ valve_1 ◂▸ reactor     waste_aqueous
                                                       ║
                                flask_base ▸ valve_2 ◂▸ separator           waste_organic

Each valve has a pump of 25 mL at its common port.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.errors import Finding, LabError
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.on_rig.chemistry import read_chemistry
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.domain.recipes.plans import claims, compiled, recipe, unproved
from tests.domain.recipes.rigs import chemputer, rig_of

LABS = Path(__file__).parents[3] / "fixtures/labs"
PLUMBED = (
    "flask_water:0 > valve_1:0",
    "flask_dcm:0 > valve_1:1",
    "flask_acid:0 > valve_1:2",
    "flask_acetone:0 > valve_1:3",
    "valve_1:4 = reactor:0",
    "pump_1:0 = valve_1:-1",
    "valve_1:5 = valve_2:5",
    "pump_2:0 = valve_2:-1",
    "flask_base:0 > valve_2:0",
    "valve_2:1 = separator:bottom",
    "valve_2:2 > waste_aqueous:0",
    "valve_2:3 > waste_organic:0",
    "valve_2:4 = flask_spare:0",
)
GROUPS = {
    "water": ["water"],
    "dcm": ["halogenated"],
    "acid": ["acid", "water"],
    "base": ["base", "water"],
    "acetone": ["ketone"],
}
TAKES = {
    "waste_aqueous": ["aqueous", "acid", "base"],
    "waste_organic": ["halogenated", "organic"],
}
BOTH = {"waste_aqueous": ["aqueous", "acid", "base"], "waste_organic": ["aqueous", "acid"]}
REAGENTS = ("water", "dcm", "acid", "base", "acetone")
HARDWARE = '<Component id="reactor" type="reactor"/><Component id="separator" type="separator"/>'


def two_wastes(takes: Mapping[str, list[str]] = TAKES) -> dict[str, Any]:
    graph = chemputer(*PLUMBED)
    for node in graph["nodes"]:
        name = node["id"].removeprefix("flask_")
        node["chemical"] = name if node["id"] != name and name != "spare" else ""
        if not node["id"].startswith(("pump", "valve")):
            node["max_volume"] = 500
        if node["id"] in takes:
            node["takes"] = takes[node["id"]]
    return graph


def text(*steps: str) -> str:
    """Write a recipe whose `waste` is the one that the compiler chooses."""
    hardware = HARDWARE + '<Component id="filter" type="filter"/>'
    return recipe(*steps, hardware=hardware, reagents=REAGENTS)


def clean(name: str, ml: int = 10) -> str:
    return f'CleanVessel vessel="reactor" solvent="{name}" volume="{ml} mL" repeats="1"'


def stirred(graph: dict[str, Any]) -> dict[str, Any]:
    graph["nodes"].append({"id": "stirrer", "class": "HeiTORQUE_100"})
    link = {"id": "stirrer", "source": "stirrer", "target": "reactor", "port": "(,)"}
    graph["links"].append(link)
    return graph


def poured(plan: dict[str, Any]) -> list[str]:
    return [does["to"] for does in claims(plan, "transfer") if does["to"].startswith("waste")]


def refused(steps: str, graph: dict[str, Any], wish: CompileWish) -> list[Finding]:
    with pytest.raises(LabError) as caught:
        compiled(steps, graph, wish)
    return list(caught.value.findings)


def test_each_liquid_goes_into_the_waste_that_takes_it() -> None:
    plan = compiled(
        text(clean("dcm"), clean("acid"), clean("acetone")),
        stirred(two_wastes()),
        CompileWish(groups=GROUPS, rinse=("acetone",)),
    )
    assert poured(plan) == ["waste_organic", "waste_aqueous", "waste_organic"]
    assert plan["groups"]["acid"] == ["acid", "water"]


def test_a_liquid_of_which_nobody_says_what_it_is_is_refused_where_wastes_are_divided() -> None:
    found = refused(text(clean("dcm")), stirred(two_wastes()), CompileWish())
    assert [one.code for one in found] == ["plan.unknown_chemistry"]
    assert "dcm" in found[0].message
    assert "declare its groups" in found[0].message


def test_wastes_that_are_not_divided_take_what_nobody_knows() -> None:
    assert poured(compiled(text(clean("dcm")), stirred(two_wastes({})))) == ["waste_aqueous"]


def test_the_groups_that_a_flask_of_the_graph_says_count() -> None:
    graph = stirred(two_wastes())
    next(n for n in graph["nodes"] if n["id"] == "flask_dcm")["groups"] = ["halogenated"]
    plan = compiled(text(clean("dcm")), graph)
    assert poured(plan) == ["waste_organic"]
    plan["groups"] = {}
    assert "interpret.chemistry" in {one.code for one in unproved(plan, rig_of(graph))}


def test_a_lab_of_ours_says_it_at_its_materials_and_wastes() -> None:
    lab = json.loads((LABS / "starter/lab.json").read_text("utf-8"))
    waste = next(one for one in lab["resources"] if one["key"] == "waste")
    waste["config"]["takes"] = ["aqueous"]
    equipment = Equipment(read_rig(json.dumps(lab).encode()))
    chemistry, findings = read_chemistry(equipment, (), {"w": ("water",)}, {})
    assert findings == []
    assert chemistry.takes == {"waste": {"aqueous"}}
    assert chemistry.groups["w"] == {"water"}
    lab["materials"][0] |= {"groups": ["base", "our own word"], "inchikey": None}
    equipment = Equipment(read_rig(json.dumps(lab).encode()))
    assert read_chemistry(equipment, (), {"w": ("water",)}, {})[0].groups["w"] == {"base"}
    waste["config"]["takes"] = ["everything"]
    with pytest.raises(LabError) as caught:
        read_rig(json.dumps(lab).encode())
    assert caught.value.findings[0].context == {"field": "takes"}


def test_a_cas_number_says_what_a_pure_reagent_is() -> None:
    graph = stirred(two_wastes())
    plain = text(clean("dcm")).replace('id="dcm"', 'id="dcm" cas="75-09-2"')
    assert poured(compiled(plain, graph)) == ["waste_organic"]
    solution = plain.replace("75-09-2", "1310-73-2")
    assert [one.code for one in refused(solution, graph, CompileWish())] == [
        "plan.unknown_chemistry"
    ]


def test_no_waste_for_a_stream_names_what_each_takes() -> None:
    takes = {"waste_aqueous": ["aqueous"], "waste_organic": ["organic"]}
    found = refused(text(clean("dcm")), stirred(two_wastes(takes)), CompileWish(groups=GROUPS))
    assert [one.code for one in found] == ["plan.no_stream"]
    assert "waste_organic takes organic" in found[0].message


def test_acid_does_not_go_onto_base_while_another_waste_takes_it() -> None:
    plan = compiled(
        text(clean("base"), clean("acid")),
        stirred(two_wastes(BOTH)),
        CompileWish(groups=GROUPS, rinse=("water",)),
    )
    assert poured(plan) == ["waste_aqueous", "waste_organic"]


def test_what_must_not_meet_is_refused_with_both_names_and_the_vessel() -> None:
    wish = CompileWish(groups=GROUPS, rinse=("water",))
    found = refused(text(clean("base"), clean("acid")), stirred(two_wastes()), wish)
    assert [one.code for one in found] == ["plan.incompatible"]
    message = found[0].message
    assert all(word in message for word in ("acid", "base", "waste_aqueous", "empty"))


def test_an_acid_that_the_recipe_has_neutralized_goes_onto_either() -> None:
    steps = (
        clean("base"),
        'Add vessel="reactor" reagent="acid" volume="10 mL"',
        'Add vessel="reactor" reagent="base" volume="10 mL"',
        'Transfer from_vessel="reactor" to_vessel="waste_aqueous" volume="all"',
    )
    wish = CompileWish(groups=GROUPS, rinse=("water",))
    assert poured(compiled(text(*steps), stirred(two_wastes(BOTH)), wish))[-1] == "waste_aqueous"


def test_what_the_recipe_pours_into_a_waste_by_name_is_looked_at_too() -> None:
    steps = (
        'Add vessel="reactor" reagent="dcm" volume="10 mL"',
        'Transfer from_vessel="reactor" to_vessel="waste_aqueous" volume="all"',
    )
    found = refused(text(*steps), two_wastes(), CompileWish(groups=GROUPS))
    assert [one.code for one in found] == ["plan.no_stream"]


def test_of_parted_phases_the_recipe_says_into_which_waste() -> None:
    separate = (
        'Separate from_vessel="reactor" separation_vessel="separator" to_vessel="reactor" '
        'purpose="extract" product_phase="bottom" solvent="dcm" solvent_volume="20 mL"{}'
    )
    add = 'Add vessel="reactor" reagent="water" volume="20 mL"'
    graph = stirred(two_wastes())
    graph["nodes"].append({"id": "stirrer_s", "class": "HeiTORQUE_100"})
    link = {"id": "s", "source": "stirrer_s", "target": "separator", "port": "(,)"}
    graph["links"].append(link)
    wish = CompileWish(groups=GROUPS)
    found = refused(text(add, separate.format("")), graph, wish)
    assert {one.code for one in found} == {"plan.no_stream"}
    named = separate.format(' waste_phase_to_vessel="waste_aqueous"')
    plan = compiled(text(add, named), graph, wish)
    assert claims(plan, "separate")[0]["upper_to"] == "waste_aqueous"


def test_a_word_that_is_no_group_and_a_name_that_is_nowhere_are_told() -> None:
    wish = CompileWish(groups={"dcm": ["halogenate"], "ether": ["ether"]})
    found = refused(text(clean("dcm")), stirred(two_wastes()), wish)
    codes = {one.code for one in found}
    assert codes >= {"plan.unknown_group", "xdl.not_declared"}
    assert any("'halogenated'" in one.message for one in found)


def test_the_verifier_refuses_a_waste_that_does_not_take_it() -> None:
    graph = stirred(two_wastes())
    plan = compiled(text(clean("dcm")), graph, CompileWish(groups=GROUPS))
    for step in plan["steps"]:
        if step["does"].get("to") == "waste_organic":
            step["does"]["to"] = "waste_aqueous"
            for group in step["actions"]:
                for command in group:
                    if command["device"] == "valve_2" and command["parameters"] == {"port": "3"}:
                        command["parameters"] = {"port": "2"}
    assert {one.code for one in unproved(plan, rig_of(graph))} == {"interpret.waste"}


def test_the_verifier_refuses_what_must_not_meet_in_a_waste() -> None:
    graph = stirred(two_wastes({}))
    plan = compiled(text(clean("dcm"), clean("water")), graph)
    plan["groups"] = {"dcm": ["oxidizer"], "water": ["alcohol"]}
    plan["keeps_apart"] = True
    found = {one.code for one in unproved(plan, rig_of(graph))}
    assert found == {"interpret.incompatible", "interpret.residue"}


@pytest.mark.parametrize(("size_ml", "tube_ml"), [(1e-6, ""), (500, 1e6)])
def test_a_waste_that_one_move_fills_hundreds_of_times_is_refused(
    size_ml: float, tube_ml: float | str
) -> None:
    graph = stirred(two_wastes({}))
    for node in graph["nodes"]:
        if node["id"].startswith("waste"):
            node["max_volume"] = size_ml
    for link in graph["links"]:
        link["volume"] = tube_ml
    found = refused(text(clean("dcm")), graph, CompileWish(primes=True))
    assert {one.code for one in found} == {"plan.overflow"}
    assert "more than 500 times" in found[0].message


def test_what_a_person_has_seen_to_be_there_goes_into_no_waste_that_does_not_take_it() -> None:
    steps = text(
        'Add vessel="separator" reagent="water" volume="2 mL"',
        'SeparatePhases separation_vessel="separator" lower_phase_vessel="reactor" '
        'upper_phase_vessel="separator"',
        'Transfer from_vessel="separator" to_vessel="waste_aqueous" volume="2 mL"',
    )
    graph = two_wastes({"waste_aqueous": ["acid"], "waste_organic": ["aqueous"]})
    found = refused(steps, graph, CompileWish(groups=GROUPS))
    assert [one.code for one in found] == ["plan.no_stream"]
    assert "waste_organic" not in found[0].context["wastes"]
    allowed = two_wastes({"waste_aqueous": ["aqueous"], "waste_organic": ["aqueous"]})
    assert claims(compiled(steps, allowed, CompileWish(groups=GROUPS)))[-1]["to"] == "waste_aqueous"
