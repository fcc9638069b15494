"""Tubes that say what they hold.

water ▸ valve_1 ◂▸ reactor     waste_1      The tube of the flask holds 0.4 mL,
argon ▸    ╨ pump_1, 25 mL                  the one to the reactor 0.6 mL.
"""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.errors import LabError
from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.domain.recipes.plans import claims, compiled, recipe, unproved
from tests.domain.recipes.rigs import chemputer, rig_of

STEPS = recipe(
    'Add vessel="reactor" reagent="water" volume="10 mL"',
    'Add vessel="reactor" reagent="water" volume="5 mL"',
    hardware='<Component id="reactor" type="reactor"/>',
    reagents=("water",),
)
PRIMED = CompileWish(primes=True)
VOLUMES = {"flask_water": 0.4, "reactor": 0.6}


def rig(volumes: dict[str, float] = VOLUMES, *, has_gas: bool = True) -> dict[str, Any]:
    gas = ("flask_argon:0 > valve_1:4",) if has_gas else ()
    graph = chemputer(
        "flask_water:0 > valve_1:0",
        "valve_1:1 = reactor:0",
        "valve_1:2 > waste_1:0",
        "pump_1:0 = valve_1:-1",
        *gas,
    )
    chemicals = {"flask_water": "water", "flask_argon": "argon"}
    for node in graph["nodes"]:
        node["chemical"] = chemicals.get(node["id"], "")
        if not node["id"].startswith("pump"):
            node["max_volume"] = 100
    for link in graph["links"]:
        for end in (link["source"], link["target"]):
            if end in volumes:
                link["volume"] = volumes[end]
    return graph


def test_a_tube_is_filled_once_and_each_delivery_pushed_out_by_gas() -> None:
    plan = compiled(STEPS, rig(), PRIMED)
    kinds = [does["kind"] for does in claims(plan)]
    assert kinds == ["fill", "prime", "transfer", "push", "transfer", "push"]
    assert claims(plan, "prime")[0] == {
        "kind": "prime",
        "from": "flask_water",
        "to": "waste_1",
        "volume_ul": 800.0,
        "lot": "water",
    }
    assert {does["volume_ul"] for does in claims(plan, "push")} == {1200.0}
    totals = plan["totals"]
    assert totals["primed_ul"] == {"water": 800.0}
    assert totals["needed_ul"] == {"water": 15800.0}
    assert totals["delivered_ul"] == {"reactor": {"water": 15000.0}}


def test_where_no_tube_says_what_it_holds_nothing_is_done() -> None:
    plan = compiled(STEPS, rig({}), PRIMED)
    assert [does["kind"] for does in claims(plan)] == ["fill", "transfer", "transfer"]
    assert plan["totals"]["primed_ul"] == {}


def test_nothing_is_primed_that_nobody_asks_for() -> None:
    plan = compiled(STEPS, rig())
    assert [does["kind"] for does in claims(plan)] == ["fill", "transfer", "transfer"]


def test_where_no_gas_gets_there_a_note_says_how_much_stays() -> None:
    plan = compiled(STEPS, rig(has_gas=False), PRIMED)
    assert claims(plan, "push") == []
    assert any("up to 0.60 mL stay in the tube to reactor" in note for note in plan["notes"])


def two_tubes(*more: str) -> dict[str, Any]:
    graph = chemputer(
        "flask_water:0 > valve_1:0",
        "flask_water:0 > valve_2:0",
        "valve_1:1 = reactor:0",
        "valve_2:1 = separator:bottom",
        "valve_1:2 > waste_1:0",
        "pump_1:0 = valve_1:-1",
        "pump_2:0 = valve_2:-1",
        *more,
    )
    for node in graph["nodes"]:
        node["chemical"] = "water" if node["id"] == "flask_water" else ""
        if not node["id"].startswith("pump"):
            node["max_volume"] = 100
    for link in graph["links"]:
        if link["source"] == "flask_water":
            link["volume"] = 0.4
    return graph


BOTH = recipe(
    'Add vessel="reactor" reagent="water" volume="10 mL"',
    'Add vessel="separator" reagent="water" volume="5 mL"',
    'Add vessel="separator" reagent="water" volume="5 mL"',
    hardware='<Component id="reactor" type="reactor"/><Component id="separator" type="separator"/>',
    reagents=("water",),
)


def test_each_tube_of_a_flask_is_filled_before_what_goes_through_it() -> None:
    graph = two_tubes("valve_2:2 > waste_2:0")
    plan = compiled(BOTH, graph, PRIMED)
    assert [does["to"] for does in claims(plan, "prime")] == ["waste_1", "waste_2"]
    assert plan["totals"]["primed_ul"] == {"water": 1600.0}
    kinds = [does["kind"] for does in claims(plan)]
    assert kinds == ["fill", "prime", "transfer", "prime", "transfer", "transfer"]
    last = next(s for s in plan["steps"] if s["does"].get("to") == "waste_2")
    steps = [step for step in plan["steps"] if step is not last]
    for place, step in enumerate(steps, start=1):
        step["id"], step["after"] = place, list(range(1, place))
    plan["totals"] |= {"primed_ul": {"water": 800.0}}
    found = [one.code for one in unproved(plan | {"steps": steps}, rig_of(graph))]
    assert found.count("interpret.not_primed") == 1


def test_a_tube_that_no_waste_is_reached_through_is_refused() -> None:
    with pytest.raises(LabError) as caught:
        compiled(BOTH, two_tubes(), PRIMED)
    assert "plan.no_waste" in {one.code for one in caught.value.findings}


def test_the_verifier_sees_a_delivery_out_of_an_empty_tube_and_a_wrong_sum() -> None:
    graph = rig()
    plan = compiled(STEPS, graph, PRIMED)
    steps = [step for step in plan["steps"] if step["does"]["kind"] != "prime"]
    for place, step in enumerate(steps, start=1):
        step["id"], step["after"] = place, list(range(1, place))
    totals = {"primed_ul": {"water": 800.0}}
    found = {one.code for one in unproved(plan | {"steps": steps, "totals": totals}, rig_of(graph))}
    assert {"interpret.not_primed", "interpret.totals"} <= found
