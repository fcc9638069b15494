"""What a plan does about vacuum that is on more than one vessel, or on before the plan begins."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.recipes.on_rig.steps import gases
from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.domain.recipes.plans import (
    ATTACHED,
    BENCH,
    bench,
    claims,
    compiled,
    reasons,
    recipe,
)
from tests.domain.recipes.rigs import chemputer

HARDWARE = (
    '<Component id="filter" type="filter"/><Component id="rotavap" type="rotavap"/>'
    '<Component id="reactor" type="reactor"/>'
)
DRY = 'Dry vessel="filter" time="1 h" pressure="20 mbar"'
TO_FILTER = 'Add vessel="filter" reagent="water" volume="5 mL"'
TO_ROTAVAP = 'Add vessel="rotavap" reagent="water" volume="20 mL"'
SOLID = 'AddSolid vessel="rotavap" reagent="water" mass="5 g"'
EVAPORATE = 'Evaporate vessel="rotavap" time="1 h" pressure="100 mbar"'
OUT = 'Transfer from_vessel="rotavap" to_vessel="filter" volume="10 mL"'


def link(graph: dict[str, Any], source: str, target: str, port: str = "(,)") -> None:
    graph["links"].append({"id": f"{source} {target}", "source": source, "target": target})
    graph["links"][-1]["port"] = port


def shared() -> dict[str, Any]:
    """Draw the bench with a rotary evaporator whose hose joins the pump of the filter's line."""
    graph = bench()
    graph["nodes"].append({"id": "rotavap", "class": "IKARV10", "max_volume": 500})
    link(graph, "valve_1", "rotavap", "(4,evaporate)")
    link(graph, "rotavap", "valve_1", "(evaporate,4)")
    link(graph, "pump_vacuum", "rotavap")
    return graph


def always_on(*tubes: str) -> dict[str, Any]:
    """Draw the bench with a vacuum line that has no pump."""
    graph = chemputer(*(tubes or BENCH))
    for key, class_, vessel in ATTACHED[:-1]:
        graph["nodes"].append({"id": key, "class": class_})
        link(graph, key, vessel)
    for node in graph["nodes"]:
        chemical = {"flask_water": "water", "flask_argon": "argon"}.get(node["id"])
        node.update({"chemical": chemical} if chemical else {})
        node.update({} if node["id"].startswith("pump") else {"max_volume": 500})
    return graph


def steps(*lines: str) -> str:
    return recipe(*lines, hardware=HARDWARE, reagents=("water",))


def test_a_step_names_the_empty_vessel_that_its_vacuum_is_on_too() -> None:
    plan = compiled(steps(TO_FILTER, DRY), shared())
    assert [does["also"] for does in claims(plan, "vacuum", "vent")] == [["rotavap"]] * 2


def test_vacuum_that_is_drawn_further_comes_to_no_vessel_anew() -> None:
    plan = compiled(steps('SwitchVacuum vessel="filter"', DRY), shared())
    assert [(d["kind"], d.get("also")) for d in claims(plan, "vacuum", "vent")] == [
        ("vacuum", ["rotavap"]),
        ("vacuum", None),
        ("vent", ["rotavap"]),
    ]


@pytest.mark.parametrize(
    ("lines", "code"),
    [
        ((TO_ROTAVAP, DRY), "plan.vacuum_shared"),
        (('SwitchVacuum vessel="filter"', EVAPORATE), "plan.vacuum_shared"),
        (('SwitchVacuum vessel="filter"', TO_ROTAVAP), "plan.under_vacuum"),
        (('SwitchVacuum vessel="filter"', SOLID), "plan.under_vacuum"),
    ],
)
def test_what_one_vacuum_would_do_to_two_vessels_is_refused(
    lines: tuple[str, ...], code: str
) -> None:
    assert set(reasons(steps(*lines), shared())) == {code}


def test_what_a_vessel_held_before_is_not_evacuated_either() -> None:
    wish = CompileWish(holds_nl={"rotavap": {"oil": 10**6}})
    assert reasons(steps(DRY), shared(), wish) == ["plan.vacuum_shared"]


def test_a_pump_does_not_start_while_a_valve_may_join_it_to_another_vessel() -> None:
    plan = compiled(steps(TO_ROTAVAP, EVAPORATE), shared())
    vacuum = next(s for s in plan["steps"] if s["does"]["kind"] == "vacuum")
    assert [c["device"] for group in vacuum["actions"] for c in group] == [
        "valve_gas",
        "pump_vacuum",
    ]
    assert vacuum["actions"][0][0]["parameters"]["port"] not in ("0", "1", "-1")


def test_after_boiling_down_a_person_says_that_there_is_as_much_as_is_drawn() -> None:
    plan = compiled(steps(TO_ROTAVAP, EVAPORATE, OUT), shared())
    last = next(s for s in plan["steps"] if s["does"].get("from") == "rotavap")
    found = last["actions"][0][0]
    assert (found["device"], found["action"]) == ("@by_hand", "check")
    assert found["parameters"]["vessel"] == "rotavap"
    assert found["parameters"]["least_ul"] == 10_000


def test_a_flask_is_not_drawn_from_by_the_port_of_its_collecting_flask() -> None:
    graph = shared()
    graph["links"] = [one for one in graph["links"] if one["id"] != "rotavap valve_1"]
    link(graph, "rotavap", "valve_1", "(collect,5)")
    assert reasons(steps(TO_ROTAVAP, OUT), graph) == ["plan.unknown_port"]


def test_the_port_of_the_collecting_flask_does_not_mean_the_other_flask() -> None:
    graph = shared()
    graph["links"] = [one for one in graph["links"] if one["source"] != "flask_ether"]
    link(graph, "rotavap", "valve_1", "(collect,1)")
    collect = 'Transfer from_vessel="rotavap" to_vessel="reactor" volume="all" from_port="collect"'
    assert reasons(steps(TO_ROTAVAP, collect), graph) == ["plan.nothing_there"]


def test_vessels_are_taken_off_a_vacuum_that_is_always_on_before_anything_else() -> None:
    wish = CompileWish(holds_nl={"filter": {"oil": 10**6}})
    text = recipe(TO_FILTER, 'Filter vessel="filter"')
    plan = compiled(text, always_on(), wish)
    first = plan["steps"][0]
    assert first["of"]["operation"] == "Prepare"
    assert first["does"] == {"kind": "vent", "vessel": "filter"}
    assert [c["device"] for group in first["actions"] for c in group] == ["valve_gas"]


def test_a_plan_that_leaves_the_vacuum_on_is_not_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(_: object) -> None:
        pass

    monkeypatch.setattr(gases, "close_vacuum", nothing)
    with pytest.raises(AssertionError, match="vacuum_on"):
        compiled(recipe(TO_FILTER), always_on())


def test_a_vacuum_that_no_valve_takes_off_a_vessel_is_refused() -> None:
    tubes = [tube for tube in BENCH if "valve_gas" not in tube] + ["filter:bottom > vacuum:0"]
    assert reasons(recipe(TO_FILTER), always_on(*tubes)) == ["plan.no_valve"]


def test_a_valve_that_never_rests_is_refused() -> None:
    graph = bench()
    for port in range(2, 6):
        link(graph, "flask_argon", "valve_gas", f"(0,{port})")
    assert reasons(recipe(TO_FILTER, DRY), graph) == ["plan.no_valve"]
