"""Cases in which compiler and verifier have differed: each plan is proved."""

from __future__ import annotations

import json

from labweb.domain.graph.rig.rig_read import read_rig
from tests.domain.recipes.plans import bench, claims, compiled, reasons, recipe, unproved


def test_a_second_thermostat_takes_over_in_a_step_of_its_own() -> None:
    graph = bench()
    graph["nodes"].append({"id": "chiller", "class": "JULABOCF41"})
    link = {"id": "chiller", "source": "chiller", "target": "reactor", "port": "(,)"}
    graph["links"].append(link)
    text = recipe(
        'Add vessel="reactor" reagent="water" volume="10 mL"',
        'HeatChillToTemp vessel="reactor" temp="150 °C"',
        'HeatChillToTemp vessel="reactor" temp="-10 °C"',
    )
    kinds = [does["kind"] for does in claims(compiled(text, graph), "heat", "stop_heat")]
    assert kinds == ["heat", "stop_heat", "heat", "stop_heat"]


def test_room_that_nobody_knows_of_is_asked_for_before_each_part_of_an_addition() -> None:
    text = recipe(
        'Add vessel="reactor" reagent="water" volume="60 mL"',
        'Separate from_vessel="reactor" separation_vessel="separator" to_vessel="filter" '
        'purpose="wash" product_phase="bottom" solvent="ether" solvent_volume="40 mL"',
        'Add vessel="filter" reagent="ether" volume="90 mL"',
    )
    plan = compiled(text, bench(filter=120, flask_ether=50))
    asked = [
        action["parameters"]["text"]
        for step in plan["steps"]
        for group in step["actions"]
        for action in group
        if step["does"].get("to") == "filter" and action["action"] == "check"
    ]
    parts = ("90.00", "50.00", "30.00")
    assert asked == [f"filter has room for {part} mL" for part in parts]


def test_a_reagent_out_of_two_flasks_is_bound_to_both() -> None:
    graph = bench()
    graph["nodes"].append({"id": "flask_far", "class": "ChemputerFlask", "chemical": "ether"})
    link = {"id": "far", "source": "flask_far", "target": "valve_2", "port": "(0,4)"}
    graph["links"] = [n for n in graph["links"] if "flask_spare" not in (n["source"], n["target"])]
    graph["links"].append(link)
    text = recipe(
        'Add vessel="reactor" reagent="ether" volume="10 mL"',
        'Add vessel="filter" reagent="ether" volume="10 mL"',
    )
    plan = compiled(text, graph)
    assert plan["bindings"]["reagents"] == {"ether": ["flask_ether", "flask_far"]}


def test_a_wait_of_a_recipe_is_held_to_its_place_in_its_queue() -> None:
    wait = 'Wait time="5 min"'
    queued = f'<Async pid="b"><{wait}/></Async>'
    steps = ('Stir vessel="reactor" time="10 min" queue="a"', f'{wait} queue="a"', wait)
    text = recipe('Await pid="b"', *steps).replace('<Await pid="b"/>', queued)
    text = text.replace("</Procedure>", '<Await pid="b"/><Confirm msg="ready"/></Procedure>')
    graph = bench()
    plan = compiled(text, graph)
    where = [step["of"].get("beside", step["of"].get("queue")) for step in plan["steps"]]
    assert where == ["b", "a", "a", "a", "a", None, None]
    rig = read_rig(json.dumps(graph).encode())
    for place in (2, 3, 4, 5, 6):
        wrong = json.loads(json.dumps(plan))
        wrong["steps"][place]["after"] = []
        assert "interpret.unordered" in {finding.code for finding in unproved(wrong, rig)}, place


def test_a_vessel_that_is_left_to_drift_comes_to_what_is_on_its_way_and_to_nothing_else() -> None:
    hot = 'HeatChill vessel="reactor" temp="80 °C" time="10 min"'
    drift = (
        'HeatChillToTemp vessel="reactor" temp="{} °C" active="false" continue_heatchill="false"'
    )
    plan = compiled(recipe(hot, drift.format(50), drift.format(25)), bench())
    assert [does["low_c"] for does in claims(plan, "reach")] == [79.0, 49.0, 24.0]
    assert reasons(recipe(drift.format(300)), bench()) == ["plan.never_reached"]
    assert reasons(recipe(hot, drift.format(90)), bench()) == ["plan.never_reached"]
    assert reasons(recipe(hot, drift.format(0)), bench()) == ["plan.never_reached"]
    assert reasons(recipe(hot, drift.format(50), drift.format(70)), bench()) == [
        "plan.never_reached"
    ]
