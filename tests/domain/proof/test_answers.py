"""Answers to requests: tubes that meet at one port, and devices that wait."""

from __future__ import annotations

import json
from typing import Any

import pytest

from labweb.domain.proof.plumbing import Plumbing
from labweb.domain.proof.transfer_judge import check_answer
from tests.domain.proof.bench import act, draw, port, push
from tests.domain.recipes.rigs import ask, chemputer, rig_of

# flask_a ── 0│valve_1│-1 ── pump_1 (and something else);  5 ── waste_b
VALVE = ("flask_a:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:5 > waste_b:0")
REQUEST = {"from": "flask_a", "to": "waste_b", "volume": "1 mL"}
STROKE = [
    [port("valve_1", "0")],
    [draw("pump_1", 1_000)],
    [port("valve_1", "5")],
    [push("pump_1", 1_000)],
]


def found(graph: dict[str, Any], steps: list[Any], **more: object) -> set[str]:
    request, answer = {**REQUEST, **more}, {"ok": True, "steps": steps}
    lines = (json.dumps(line).encode() for line in (request, answer))
    return {finding.code for finding in check_answer(Plumbing(rig_of(graph)), *lines)}


def solenoid(graph: dict[str, Any], *ports: str) -> dict[str, Any]:
    """Join a solenoid to the common port of the valve; beyond it stands a flask."""
    nodes = [
        {"id": "solenoid", "class": "virtual_solenoid_valve"},
        {"id": "flask_c", "class": "ChemputerFlask"},
    ]
    ends = (("valve_1", "-1", ports[0]), ("flask_c", "0", ports[1]))
    links = [
        {"source": s, "target": t, "port": f"({a},{b})"}
        for key, own, far in ends
        for s, a, t, b in ((key, own, "solenoid", far), ("solenoid", far, key, own))
    ]
    return {"nodes": [*graph["nodes"], *nodes], "links": [*graph["links"], *links]}


@pytest.mark.parametrize(
    "more",
    [
        "valve_1:-1 > flask_c:0",
        "flask_c:0 > valve_1:-1",
        "valve_1:-1 = pump_2:0",
        "valve_1:0 = valve_1:-1",
    ],
)
def test_what_is_joined_to_the_port_that_liquid_comes_by_takes_or_gives_some_of_it(
    more: str,
) -> None:
    graph = chemputer(*VALVE, more)
    assert "interpret.divides" in found(graph, STROKE)
    assert not ask(graph, "flask_a", "waste_b", "1 mL")["ok"]


def test_a_tube_that_only_leads_away_divides_what_is_pushed_past_it() -> None:
    graph = chemputer(
        "flask_a:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:3 > valve_2:4",
        "valve_2:4 > flask_c:0", "valve_2:-1 > waste_b:0",
    )  # fmt: skip
    steps = [*STROKE[:2], [port("valve_1", "3"), port("valve_2", "4")], STROKE[3]]
    assert "interpret.divides" in found(graph, steps)
    assert not ask(graph, "flask_a", "waste_b", "1 mL")["ok"]


def test_a_shut_solenoid_ends_a_tube() -> None:
    graph = solenoid(chemputer(*VALVE), "in", "out")
    assert not found(graph, STROKE)
    assert ask(graph, "flask_a", "waste_b", "1 mL")["ok"]
    opened = [[act("solenoid open")], *STROKE, [act("solenoid close")]]
    assert "interpret.divides" in found(graph, opened)


def test_a_solenoid_with_both_tubes_at_one_side_ends_none() -> None:
    graph = solenoid(chemputer(*VALVE), "in", "in")
    assert "interpret.divides" in found(graph, STROKE)
    assert not ask(graph, "flask_a", "waste_b", "1 mL")["ok"]


def test_a_manifold_joins_whatever_is_at_it() -> None:
    tubes = (*VALVE[:2], "valve_1:5 > manifold_m:0", "manifold_m:1 > waste_b:0")
    graph = chemputer(*tubes)
    assert not found(graph, STROKE, through=["manifold_m"])
    assert ask(graph, "flask_a", "waste_b", "1 mL", through=["manifold_m"])["ok"]
    graph = chemputer(*tubes, "manifold_m:2 > flask_c:0")
    assert "interpret.divides" in found(graph, STROKE, through=["manifold_m"])
    assert not ask(graph, "flask_a", "waste_b", "1 mL", through=["manifold_m"])["ok"]


def test_a_manifold_that_nobody_names_may_lie_behind_a_cartridge() -> None:
    graph = chemputer(
        *VALVE[:2], "valve_1:5 > cartridge_c:in", "cartridge_c:out > manifold_m:0",
        "manifold_m:0 > waste_b:0",
    )  # fmt: skip
    steps = ask(graph, "flask_a", "waste_b", "1 mL", through=["cartridge_c"])["steps"]
    assert not found(graph, steps, through=["cartridge_c"])


def wait(device: str) -> dict[str, Any]:
    return act(f"{device} wait", duration_s=5)


@pytest.mark.parametrize("device", ["@timer", "pump_1", "valve_1"])
def test_a_device_may_wait_between_strokes_and_while_others_move(device: str) -> None:
    graph = chemputer(*VALVE)
    assert not found(graph, [*STROKE[:2], [wait(device)], *STROKE[2:]])
    if device != "pump_1":
        assert not found(graph, [STROKE[0], [*STROKE[1], wait(device)], *STROKE[2:]])


def test_nothing_waits_while_it_moves_and_nobody_waits_who_is_not_there() -> None:
    graph = chemputer(*VALVE)
    moving = [STROKE[0], [*STROKE[1], wait("pump_1")], *STROKE[2:]]
    assert found(graph, moving) == {"interpret.unknown_action"}
    assert found(graph, [[wait("nobody")], *STROKE]) == {"interpret.unknown_action"}


THROUGH = (
    "flask_a:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:5 > cartridge_c:in",
    "cartridge_c:out > valve_2:0", "pump_2:0 = valve_2:-1", "valve_2:5 > waste_b:0",
)  # fmt: skip
RATES = {"rate": "30 mL/min", "draw_rate": "6 mL/min", "push_rate": "12 mL/min"}


@pytest.mark.parametrize("stated", [(), ("rate",), ("draw_rate",), ("push_rate",), tuple(RATES)])
@pytest.mark.parametrize("tubes", [VALVE, THROUGH])
def test_the_rates_that_a_request_states_are_those_of_its_answer(
    stated: tuple[str, ...], tubes: tuple[str, ...]
) -> None:
    graph, rates = chemputer(*tubes), {name: RATES[name] for name in stated}
    more = {"through": ["cartridge_c"]} if tubes is THROUGH else {}
    answer = ask(graph, "flask_a", "waste_b", "60 mL", **rates, **more)
    asked = {**rates, **more, "volume": "60 mL"}
    assert found(graph, answer["steps"], **asked) == set()
    for name in stated:
        faster = asked | {name: "31 mL/min"}
        is_used = name != "rate" or not {"draw_rate", "push_rate"} <= set(stated)
        assert ("interpret.rate" in found(graph, answer["steps"], **faster)) is is_used


def test_a_rate_of_a_request_that_is_none_is_a_finding() -> None:
    assert found(chemputer(*VALVE), STROKE, rate="fast") == {"unit.unreadable"}


def test_gas_may_be_asked_for_in_any_vessel() -> None:
    graph = chemputer(*VALVE)
    graph["nodes"][0]["chemical"] = "argon"
    assert not found(graph, STROKE)
