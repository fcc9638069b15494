"""A plan is held against what the graph says that vessels hold, and that is in them.

The rig is the starter lab; the recipe brings 2 mL of water into its reactor.
"""

from __future__ import annotations

import json
from copy import deepcopy
from typing import Any

import pytest

from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.domain.recipes.plans import bench, compiled, unproved
from tests.domain.recipes.plans import recipe as on_bench
from tests.domain.recipes.test_advice_on_labs import ADD, recipe
from tests.domain.recipes.test_opening import STARTER

FILL = 'Add vessel="reactor" reagent="water" volume="20 mL"'


def starter(**capacity_ul: float) -> dict[str, Any]:
    lab: dict[str, Any] = json.loads(STARTER)
    for one in lab["resources"]:
        if one["key"] in capacity_ul:
            one["config"]["capacity_ul"] = capacity_ul[one["key"]]
    return lab


def found(plan: dict[str, Any], graph: dict[str, Any]) -> set[tuple[str, str | None]]:
    findings = unproved(plan, read_rig(json.dumps(graph).encode()))
    return {(one.code, one.context.get("vessel") or one.context.get("device")) for one in findings}


def test_a_plan_that_enlarges_the_vessels_of_a_lab_is_refused() -> None:
    plan = compiled(recipe(ADD), starter())
    assert found(plan, starter()) == set()
    plan["capacities_ul"]["reactor_1"] += 1
    assert found(plan, starter()) == {("interpret.capacity", "reactor_1")}


def test_a_vessel_of_a_lab_overflows_although_the_plan_does_not_name_its_size() -> None:
    plan = compiled(recipe(ADD), starter())
    del plan["capacities_ul"]["reactor_1"]
    assert found(plan, starter(reactor_1=2_000)) == set()
    assert found(plan, starter(reactor_1=1_999)) == {("interpret.overflow", "reactor_1")}


@pytest.mark.parametrize("share", [0, 0.999])
def test_a_plan_that_begins_with_less_than_the_graph_says_is_refused(share: float) -> None:
    plan = compiled(recipe(ADD), starter())
    wrong = deepcopy(plan)
    wrong["contents"]["acid"][0]["volume_ul"] *= share
    if not share:
        del wrong["contents"]["acid"]
    assert found(wrong, starter()) == {("interpret.contents", "acid")}


def test_a_plan_that_calls_what_is_in_a_vessel_by_another_name_is_refused() -> None:
    plan = compiled(recipe(ADD), starter())
    plan["contents"]["acid"][0]["lot"] = "Water"
    assert ("interpret.contents", "acid") in found(plan, starter())


def test_a_plan_may_begin_with_more_than_the_graph_says() -> None:
    wish = CompileWish(holds_nl={"separator": {"ether": 5_000_000}})
    assert compiled(on_bench(FILL), bench(), wish)["contents"]["separator"]


def test_a_waste_that_the_graph_fills_overflows_although_the_plan_calls_it_empty() -> None:
    graph = bench()
    plan = compiled(on_bench(FILL), graph)
    waste = next(one for one in graph["nodes"] if one["id"] == "waste_1")
    waste["current_volume"] = 400
    assert found(plan, graph) == {("interpret.contents", "waste_1")}


def test_no_plan_is_proved_on_a_syringe_that_the_graph_fills() -> None:
    graph = bench()
    plan = compiled(on_bench(FILL), graph)
    next(one for one in graph["nodes"] if one["id"] == "pump_2")["current_volume"] = 1
    assert found(plan, graph) == {("interpret.syringe_not_empty", "pump_2")}
