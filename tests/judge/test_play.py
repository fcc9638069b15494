"""A right plan passes the judge, and each of many wrong ones is refused for its own reason."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from fractions import Fraction

import pytest

from tests.judge.actions import Wait, parse_steps
from tests.judge.bench import RIGHT, bench, document
from tests.judge.harness import parse_lines
from tests.judge.mutants import MUTANTS, Change, mutated
from tests.judge.play import play
from tests.judge.reading import read_json
from tests.judge.request import Request
from tests.judge.witness import Plan, move, set_port


@pytest.mark.parametrize("plan", RIGHT.values(), ids=RIGHT)
def test_a_right_plan_passes(plan: Callable[[], tuple[Request, Plan]]) -> None:
    request, steps = plan()
    played = play(bench(), request, steps)
    assert played.is_right, f"{played.code}: {played.message}"


@pytest.mark.parametrize(
    ("name", "plan", "code", "change"), MUTANTS, ids=[mutant[0] for mutant in MUTANTS]
)
def test_a_wrong_plan_is_refused_for_its_own_reason(
    name: str, plan: str, code: str, change: Change
) -> None:
    played = play(bench(), RIGHT[plan]()[0], mutated(plan, change))
    assert played.code == code, played.message


def test_there_are_at_least_sixty_mutants_of_distinct_names_and_all_reasons() -> None:
    assert len({name for name, *_ in MUTANTS}) == len(MUTANTS) >= 60
    reasons = {code for _, _, code, _ in MUTANTS}
    assert reasons == {
        "ambiguous",
        "dry-draw",
        "form",
        "liquid-left",
        "no-path",
        "not-a-vessel",
        "not-fluid",
        "open-port",
        "overdrawn",
        "overfull",
        "pumps-collide",
        "simultaneous",
        "switched-while-moving",
        "unequal-pass",
        "unit-misuse",
        "unknown-action",
        "unknown-device",
        "unknown-port",
        "valve-unset",
        "volume",
        "wrong-vessel",
    }


def test_thirds_of_a_stroke_add_up_to_the_nanolitre() -> None:
    plan: Plan = []
    for _ in range(3):
        plan += [[set_port("V1", "1")], [move("P1", "aspirate", 10_000 / 3)]]
        plan += [[set_port("V1", "2")], [move("P1", "dispense", 10_000 / 3)]]
    assert play(bench(), Request("A", "B", 10_000_000), plan).is_right
    assert play(bench(), Request("A", "B", 10_000_001), plan).code == "volume"


def test_a_port_that_was_asked_for_has_to_be_the_one_that_is_used() -> None:
    request, steps = RIGHT["a_to_b"]()
    asked = dataclasses.replace(request, from_port="top")
    assert play(bench(), asked, steps).is_right
    asked = dataclasses.replace(request, to_port="bottom")
    assert play(bench(), asked, steps).code == "wrong-port"


def test_a_hose_of_another_medium_stops_a_plan_that_was_right() -> None:
    drawn = document()
    for link in drawn["links"]:
        if {link["source"], link["target"]} == {"V1", "B"}:
            link["type"] = "communication"
    request, steps = RIGHT["a_to_b"]()
    assert play(read_json(drawn), request, steps).code == "not-fluid"


def test_a_pump_with_two_bare_hoses_is_ambiguous() -> None:
    drawn = document()
    drawn["links"].append(
        {"source": "P1", "target": "J", "type": "fluid", "port": {"P1": "x", "J": "side"}}
    )
    request, steps = RIGHT["a_to_b"]()
    assert play(read_json(drawn), request, steps).code == "ambiguous"


def test_a_pump_at_rest_beside_the_path_is_noted() -> None:
    drawn = document()
    drawn["links"].append(
        {"source": "P1", "target": "P3", "type": "fluid", "port": {"P1": "x", "P3": "c"}}
    )
    request, steps = RIGHT["a_to_b"]()
    played = play(read_json(drawn), request, steps)
    assert played.is_right
    assert played.notes == {"a syringe at rest shuts its hose"}


def test_two_pumps_may_work_at_the_same_time_on_paths_that_do_not_meet() -> None:
    """20 mL from A to D: P1 draws the second stroke while P2 empties the first."""
    stroke = 10_000.0
    draw, give = move("P1", "aspirate", stroke), move("P2", "dispense", stroke)
    facing = [set_port("V1", "8"), set_port("V2", "1")]
    hand_over = [move("P1", "dispense", stroke), move("P2", "aspirate", stroke)]
    apart = [set_port("V1", "1"), set_port("V2", "2")]
    plan = [apart, [draw], facing, hand_over, apart, [draw, give], facing, hand_over, apart, [give]]
    assert play(bench(), Request("A", "D", 20_000_000), plan).is_right


def test_telling_a_valve_where_it_stands_is_no_turn() -> None:
    request, steps = RIGHT["a_to_b"]()
    steps[1].append(set_port("V1", "1"))
    assert play(bench(), request, steps).is_right


def test_a_number_beyond_all_measure_is_refused_at_once() -> None:
    text = '[[{"device": "P1", "action": "aspirate", "parameters": {"volume_ul": 1e999999999,'
    steps = parse_lines(text + ' "rate_ul_s": 1}}]]')[0]
    assert play(bench(), RIGHT["a_to_b"]()[0], steps).code == "unit-misuse"


def test_the_text_of_a_number_counts_and_not_its_nearest_float() -> None:
    text = '[[{"device": "", "action": "wait", "parameters": {"duration_s": 0.1}}]]'
    parsed = parse_steps(bench(), parse_lines(text)[0])
    assert [[act.duration_s for act in step if isinstance(act, Wait)] for step in parsed] == [
        [Fraction(1, 10)]
    ]
