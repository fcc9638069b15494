"""Vessels that a recipe has emptied, and empty flasks in which a phase waits."""

from __future__ import annotations

import pytest

from tests.domain.recipes.plans import bench, claims, compiled, recipe

ADD = 'Add vessel="reactor" reagent="water" volume="60 mL"'
STAYS = (
    'Separate from_vessel="reactor" separation_vessel="separator" to_vessel="separator" '
    'purpose="wash" product_phase="bottom" solvent="ether" solvent_volume="20 mL"'
)


def test_of_two_empty_flasks_the_phase_waits_in_the_one_that_holds_it() -> None:
    graph = bench(flask_spare=10)
    graph["nodes"].append({"id": "flask_tall", "class": "ChemputerFlask", "max_volume": 250})
    for source, target, port in (
        ("valve_1", "flask_tall", "(4,0)"),
        ("flask_tall", "valve_1", "(0,4)"),
    ):
        link = {"id": f"{source}-{target}", "source": source, "target": target, "port": port}
        graph["links"].append(link)
    drawn = [
        c for s in compiled(recipe(ADD, STAYS), graph)["steps"] for g in s["actions"] for c in g
    ]
    assert {"device": "valve_1", "action": "set_port", "parameters": {"port": "4"}} in drawn
    assert not any(c["action"] == "check" for c in drawn)


def test_where_a_phase_may_not_fit_into_the_flask_that_it_waits_in_a_person_looks_first() -> None:
    plan = compiled(recipe(ADD, STAYS), bench(flask_spare=10))
    (parted,) = [s for s in plan["steps"] if s["does"]["kind"] == "separate"]
    (check,) = [c for group in parted["actions"] for c in group if c["action"] == "check"]
    assert check["parameters"]["text"] == "flask_spare has room for 80.00 mL"


@pytest.mark.parametrize(
    "again",
    [
        'Transfer from_vessel="reactor" to_vessel="filter" volume="all"',
        'Transfer from_vessel="reactor" to_vessel="separator" volume="all"',
    ],
)
def test_all_of_a_vessel_that_the_recipe_has_emptied_is_noted_and_nothing_is_moved(
    again: str,
) -> None:
    once = (ADD, 'Transfer from_vessel="reactor" to_vessel="filter" volume="all"')
    plan = compiled(recipe(*once, again, ADD), bench())
    without = compiled(recipe(*once, ADD), bench())
    assert claims(plan) == claims(without)
    assert any("reactor is empty already: nothing is moved" in note for note in plan["notes"])
    assert not any("is empty already" in note for note in without["notes"])


def test_a_filter_that_was_drawn_dry_is_filtered_again_with_a_note() -> None:
    steps = ('Add vessel="filter" reagent="water" volume="20 mL"', 'Filter vessel="filter"')
    plan = compiled(recipe(*steps, steps[1]), bench())
    assert len(claims(plan, "filter")) == 1
    assert any("filter is empty already: nothing is moved to waste_2" in n for n in plan["notes"])
