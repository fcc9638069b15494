"""What a recipe says of a step beside the usual is done, or refused: ports, portions, flows.

The rig is the bench of `test_recipe_plan`.
"""

from __future__ import annotations

import json
from typing import Any

import pytest

from tests.domain.recipes.plans import bench, claims, compiled, reasons, recipe

ADD = 'Add vessel="separator" reagent="water" volume="40 mL"'
PART = (
    'SeparatePhases separation_vessel="separator" lower_phase_vessel="{lower}" '
    'upper_phase_vessel="{upper}" {more}'
)
DISSOLVE = 'Dissolve vessel="reactor" solvent="ether" volume="10 mL" {more}'
PURGE = 'Purge vessel="filter" time="1 min" {more}'


def part(more: str = "", lower: str = "reactor", upper: str = "filter") -> str:
    return PART.format(lower=lower, upper=upper, more=more)


def two_ways() -> dict[str, Any]:
    """Return the bench with a second tube from the second valve into the reactor, at port 1."""
    graph = bench()
    links = graph["links"]
    for source, target, port in (
        ("valve_1", "reactor", "(4,1)"),
        ("reactor", "valve_1", "(1,4)"),
    ):
        links.append({"id": len(links) + 100, "source": source, "target": target, "port": port})
    return graph


def parting(plan: dict[str, Any]) -> list[dict[str, Any]]:
    (step,) = (one for one in plan["steps"] if one["does"]["kind"] == "separate")
    return [command for group in step["actions"] for command in group]


def ports(commands: list[dict[str, Any]], valve: str) -> set[str]:
    turns = (c for c in commands if (c["device"], c["action"]) == (valve, "set_port"))
    return {turn["parameters"]["port"] for turn in turns}


@pytest.mark.parametrize(("port", "turned"), [("0", "2"), ("1", "4")])
def test_the_lower_phase_comes_in_by_the_port_that_is_said(port: str, turned: str) -> None:
    text = recipe(ADD, part(f'lower_phase_port="{port}"'))
    commands = parting(compiled(text, two_ways()))
    assert turned in ports(commands, "valve_1")
    assert {"2": "4", "4": "2"}[turned] not in ports(commands, "valve_1")


@pytest.mark.parametrize(("port", "turned"), [("0", "2"), ("1", "4")])
def test_the_upper_phase_comes_in_by_the_port_that_is_said(port: str, turned: str) -> None:
    text = recipe(ADD, part(f'upper_phase_port="{port}"', lower="filter", upper="reactor"))
    assert turned in ports(parting(compiled(text, two_ways())), "valve_1")


def test_a_port_that_the_vessel_does_not_have_is_refused() -> None:
    for name in ("lower", "upper"):
        text = recipe(ADD, part(f'{name}_phase_port="9"'))
        assert set(reasons(text, bench())) <= {"plan.unknown_port", "plan.no_route"}
    assert reasons(recipe(DISSOLVE.format(more='port="9"')), bench()) == ["plan.unknown_port"]


def test_a_port_of_a_phase_that_stays_is_told_to_have_no_effect() -> None:
    text = recipe(ADD, part('upper_phase_port="top"', upper="separator"))
    notes = compiled(text, bench())["notes"]
    assert any("upper_phase_port has no effect" in note for note in notes)


@pytest.mark.parametrize(("phase", "reading"), [("bottom", "falls"), ("top", "rises"), ("", None)])
def test_which_phase_conducts_says_what_the_reading_does_at_the_boundary(
    phase: str, reading: str | None
) -> None:
    more = f'high_conductivity_phase="{phase}"' if phase else ""
    commands = parting(compiled(recipe(ADD, part(more)), bench()))
    (watch,) = (c for c in commands if c["action"] == "watch_boundary")
    assert watch["parameters"].get("reading") == reading


def test_a_person_who_watches_is_told_which_phase_conducts() -> None:
    graph = bench()
    graph["nodes"] = [node for node in graph["nodes"] if node["id"] != "sensor"]
    graph["links"] = [link for link in graph["links"] if link["source"] != "sensor"]
    plan = compiled(recipe(ADD, part('high_conductivity_phase="bottom"')), graph)
    (watch,) = (c for c in parting(plan) if c["action"] == "watch")
    assert watch["parameters"]["text"].endswith("the bottom one conducts better")


def test_the_lower_phase_is_drawn_in_portions() -> None:
    whole = parting(compiled(recipe(ADD, part()), bench()))
    portions = parting(compiled(recipe(ADD, part('step_volume="5 mL"')), bench()))

    def drawn(commands: list[dict[str, Any]]) -> list[float]:
        until = [c["parameters"] for c in commands if c["parameters"].get("until") == "boundary"]
        return [one["volume_ul"] for one in until]

    assert drawn(portions) == [5000.0] * 8
    assert max(drawn(whole)) > 5000.0
    assert sum(drawn(whole)) == sum(drawn(portions)) == 40_000.0


def test_portions_that_are_too_small_or_none_are_refused() -> None:
    for step, code in (("0.01 mL", "plan.too_many_rounds"), ("0 mL", "unit.not_positive")):
        found = reasons(recipe(ADD, part(f'step_volume="{step}"')), bench())
        assert found == [code]


@pytest.mark.parametrize(("port", "turned"), [("0", "2"), ("1", "4")])
def test_a_solvent_that_dissolves_comes_in_by_the_port_that_is_said(port: str, turned: str) -> None:
    plan = compiled(recipe(DISSOLVE.format(more=f'port="{port}"')), two_ways())
    (move,) = (step for step in plan["steps"] if step["does"]["kind"] == "transfer")
    commands = [command for group in move["actions"] for command in group]
    assert turned in ports(commands, "valve_1")


@pytest.mark.parametrize(
    ("more", "wanted"),
    [
        ("", []),
        ('flow_rate="50 mL/min"', ["is set to 50 mL/min"]),
        ('flow_rate="50 mL/min" pressure="1.2 bar"', ["50 mL/min", "is set to 1200 mbar"]),
    ],
)
def test_a_person_sees_that_the_gas_flows_as_the_recipe_says(more: str, wanted: list[str]) -> None:
    plan = compiled(recipe(PURGE.format(more=more)), bench())
    (gas,) = (step for step in plan["steps"] if step["does"]["kind"] == "gas")
    checks = [c for group in gas["actions"] for c in group if c["action"] == "check"]
    told = json.dumps([check["parameters"]["text"] for check in checks])
    assert len(checks) == len(wanted)
    assert all(text in told for text in wanted)
    assert claims(plan, "gas", "wait", "stop_gas")


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_loop_goes_round_as_often_as_it_says_and_not_at_all_for_none(count: int) -> None:
    loop = f'Repeat repeats="{count}"><Add vessel="reactor" reagent="water" volume="5 mL"/></Repeat'
    text = recipe(ADD).replace("</Procedure>", f"<{loop}></Procedure>")
    (alone, looped) = (compiled(one, bench()) for one in (recipe(ADD), text))
    more_ul = looped["totals"]["needed_ul"]["water"] - alone["totals"]["needed_ul"].get("water", 0)
    assert more_ul == 5000 * count


@pytest.mark.parametrize(
    "step",
    [
        'Separate from_vessel="separator" separation_vessel="separator" to_vessel="reactor" '
        'purpose="extract" product_phase="bottom" solvent="ether" repeats="0"',
        'WashSolid vessel="filter" solvent="water" volume="5 mL" repeats="0"',
    ],
)
def test_a_step_that_is_to_be_done_no_times_is_refused(step: str) -> None:
    assert "unit.not_positive" in reasons(recipe(ADD, step), bench())


def test_a_reagent_does_not_go_into_the_flask_that_it_comes_out_of() -> None:
    step = 'Add vessel="flask_water" reagent="water" volume="5 mL"'
    assert reasons(recipe(step), bench()) == ["plan.shared_flask", "plan.same_vessel"]


@pytest.mark.parametrize("rate", ['speed="0 mL/min"', 'aspiration_speed="0 mL/min"'])
def test_a_rate_of_nothing_is_refused_and_not_taken_for_none(rate: str) -> None:
    step = f'Add vessel="reactor" reagent="water" volume="5 mL" {rate}'
    assert reasons(recipe(step), bench()) == ["unit.not_positive"]


def test_a_time_of_nothing_is_refused_and_not_taken_for_none() -> None:
    step = 'Add vessel="reactor" reagent="water" volume="5 mL" time="0 s"'
    assert reasons(recipe(step), bench()) == ["unit.not_positive"]
