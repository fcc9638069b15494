"""What is washed out of syringes and valves before a liquid that must not meet it.

flask_water, flask_dcm, flask_acid, flask_acetone ▸ valve_1 ◂▸ reactor     waste_aqueous
                                                   ║
                         flask_acetone ▸ valve_2 ◂▸ separator           waste_organic
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from labweb.domain.errors import LabError
from labweb.domain.recipes.recipe_to_plan import CompileWish
from labweb.domain.resources.compatibility_table import STREAMS
from tests.domain.recipes.plans import claims, compiled, unproved
from tests.domain.recipes.rigs import rig_of
from tests.domain.recipes.test_wastes import REAGENTS, refused, text, two_wastes

CHLORIDE = {"acid": ["water_reactive"], "water": ["water"], "acetone": ["ketone"]}


def add(name: str, vessel: str = "reactor") -> str:
    return f'Add vessel="{vessel}" reagent="{name}" volume="5 mL"'


def rinses(plan: dict[str, Any]) -> list[tuple[str, str]]:
    return [(does["lot"], does["to"]) for does in claims(plan, "clean")]


def test_what_reacts_with_water_is_washed_out_three_times_before_water_comes() -> None:
    steps = text(add("acid"), add("water", "separator"))
    graph = two_wastes({"waste_aqueous": ["aqueous"], "waste_organic": ["organic"]})
    plan = compiled(steps, graph, CompileWish(groups=CHLORIDE, rinse=("acetone",)))
    assert rinses(plan)[:3] == [("acetone", "waste_organic")] * 3
    assert [does["volume_ul"] for does in claims(plan, "clean")][:3] == [3000.0] * 3
    assert plan["totals"]["needed_ul"]["acetone"] == 3000.0 * len(rinses(plan))
    assert plan["totals"]["delivered_ul"] == {
        "reactor": {"acid": 5000.0},
        "separator": {"water": 5000.0},
    }


def test_without_a_solvent_that_goes_with_both_it_is_refused_with_what_would_help() -> None:
    steps = text(add("acid"), add("water", "separator"))
    for wish in (
        CompileWish(groups=CHLORIDE),
        CompileWish(groups=CHLORIDE, rinse=("base",)),
        CompileWish(groups=CHLORIDE | {"base": ["base"]}, rinse=("base",)),
    ):
        found = refused(steps, two_wastes({}), wish)
        assert [one.code for one in found] == ["plan.no_rinse"]
        assert "acid" in found[0].message
        assert "--rinse" in found[0].message


def test_two_solvents_lead_from_one_liquid_to_the_next_when_no_single_one_does() -> None:
    groups = {
        "acid": ["reactive_metal"],
        "water": ["water"],
        "dcm": ["hydrocarbon"],
        "acetone": ["ketone"],
        "base": ["oxidizer"],
    }
    steps = text(add("base"), add("acid", "separator"))
    one = CompileWish(groups=groups, rinse=("dcm", "acetone"))
    assert [one.code for one in refused(steps, two_wastes({}), one)] == ["plan.no_rinse"]
    both = CompileWish(groups=groups, rinse=("dcm", "acetone", "water"))
    washed = [lot for lot, _ in rinses(compiled(steps, two_wastes({}), both))]
    assert washed[:6] == ["water"] * 3 + ["dcm"] * 3


def test_a_rinse_turns_back_from_a_syringe_that_no_straight_way_goes_over() -> None:
    graph = two_wastes({})
    for link in graph["links"]:
        ends = {"flask_acetone": "(0,0)", "flask_base": "(0,3)"}
        if link["source"] in ends:
            link["port"] = ends[link["source"]]
            link["target"] = "valve_2" if link["source"] == "flask_acetone" else "valve_1"
    steps = text(add("acid"), add("water", "separator"))
    plan = compiled(steps, graph, CompileWish(groups=CHLORIDE, rinse=("acetone",)))
    rinse = next(step for step in plan["steps"] if step["does"]["kind"] == "clean")
    moved = [c for group in rinse["actions"] for c in group if c["action"] == "aspirate"]
    assert [command["device"] for command in moved] == ["pump_2", "pump_1", "pump_2"]


def test_nothing_is_rinsed_where_nobody_says_what_liquids_are() -> None:
    steps = text(add("acid"), add("water", "separator"))
    assert rinses(compiled(steps, two_wastes({}))) == []


def test_after_enough_of_another_liquid_nothing_is_left_of_the_first() -> None:
    more = 'Add vessel="reactor" reagent="dcm" volume="9 mL"'
    groups = CHLORIDE | {"dcm": ["halogenated"]}
    through = text(add("acid"), more, add("water", "separator"))
    assert rinses(compiled(through, two_wastes({}), CompileWish(groups=groups))) == []
    less = text(add("acid"), more.replace("9 mL", "8 mL"), add("water", "separator"))
    found = refused(less, two_wastes({}), CompileWish(groups=groups))
    assert [one.code for one in found] == ["plan.no_rinse"]


def test_what_the_recipe_lets_meet_in_the_vessel_is_no_residue_but_is_told() -> None:
    plan = compiled(text(add("acid"), add("water")), two_wastes({}), CompileWish(groups=CHLORIDE))
    assert rinses(plan) == []
    assert any(
        "water follows acid through the same syringes" in note and "in reactor" in note
        for note in plan["notes"]
    )


def test_the_verifier_misses_rinses_that_are_left_out() -> None:
    graph = two_wastes({})
    steps = text(add("acid"), add("water", "separator"))
    plan = compiled(steps, graph, CompileWish(groups=CHLORIDE, rinse=("acetone",)))
    rig = rig_of(graph)
    cut = [step for step in plan["steps"] if step["does"]["kind"] != "clean"]
    for place, step in enumerate(cut, start=1):
        step["id"], step["after"] = place, list(range(1, place))
    found = {one.code for one in unproved(plan | {"steps": cut, "totals": {}}, rig)}
    assert "interpret.residue" in found


GROUPS = st.sampled_from(sorted(STREAMS))
STREAM = st.sampled_from(sorted({stream for stream in STREAMS.values() if stream}))


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_whatever_is_declared_no_plan_is_made_that_is_not_proved(
    data: st.DataObject,
) -> None:
    declared = data.draw(
        st.dictionaries(st.sampled_from(REAGENTS), st.lists(GROUPS, min_size=1, max_size=2))
    )
    takes = data.draw(
        st.dictionaries(
            st.sampled_from(("waste_aqueous", "waste_organic")), st.lists(STREAM, max_size=6)
        )
    )
    names = st.sampled_from(REAGENTS)
    steps = []
    for _ in range(data.draw(st.integers(1, 4))):
        vessel = data.draw(st.sampled_from(("reactor", "separator")))
        steps.append(add(data.draw(names), vessel))
        if data.draw(st.booleans()):
            waste = data.draw(st.sampled_from(("waste_aqueous", "waste_organic")))
            steps.append(
                f'Transfer from_vessel="{vessel}" to_vessel="{waste}" '
                f'volume="{data.draw(st.sampled_from(("all", "2 mL")))}"'
            )
        elif data.draw(st.booleans()):
            steps.append(
                'SeparatePhases separation_vessel="separator" lower_phase_vessel="waste_aqueous" '
                'upper_phase_vessel="waste_organic"'
            )
    rinse = tuple(data.draw(st.lists(names, max_size=2, unique=True)))
    used = {name for name in declared if name in " ".join(steps) or name in rinse}
    wish = CompileWish(groups={name: declared[name] for name in used}, rinse=rinse, primes=True)
    graph = two_wastes(takes)
    for link in graph["links"]:
        link["volume"] = data.draw(st.sampled_from(("", 0.1, 0.7)))
    with suppress(LabError):
        compiled(text(*steps), graph, wish)  # asserts that the verifier proves it
