"""Cases in which compiler and verifier have differed: each plan is proved."""

from __future__ import annotations

from tests.domain.workflows.xdl.plans import bench, claims, compiled, recipe


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
