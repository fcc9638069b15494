from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.transfers_on_rig import compile_line
from tests.domain.recipes.interpreter import Plumbing, WrongError, check
from tests.domain.recipes.rigs import ask, chemputer, codes_of, rig_of, steps_of, told

# flask_a ── 0│valve_1│-1 ── pump_1    valve_1 1 ══ 2 valve_2│-1 ── pump_2, 3 ── reactor_b
TWO = chemputer(
    "flask_a:0 > valve_1:0",
    "pump_1:0 = valve_1:-1",
    "valve_1:1 = valve_2:2",
    "pump_2:0 = valve_2:-1",
    "valve_2:3 = reactor_b:0",
)


def test_one_pump_draws_and_pushes() -> None:
    graph = chemputer("flask_a:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:5 > waste_b:0")
    steps = steps_of(graph, "flask_a", "waste_b", "10 mL")
    assert told(steps) == [["valve_1 0"], ["pump_1 +10000"], ["valve_1 5"], ["pump_1 -10000"]]
    parameters = steps[1][0]["parameters"]
    assert parameters == {"volume_ul": 10_000.0, "rate_ul_s": 666.666667}


def test_two_pumps_that_face_each_other_move_at_the_same_time() -> None:
    assert told(steps_of(TWO, "flask_a", "reactor_b", "40 mL")) == [
        ["valve_1 0"],
        ["pump_1 +20000"],
        ["valve_1 1", "valve_2 2"],
        ["pump_1 -20000", "pump_2 +20000"],
        ["valve_1 0", "valve_2 3"],
        ["pump_1 +20000", "pump_2 -20000"],
        ["valve_1 1", "valve_2 2"],
        ["pump_1 -20000", "pump_2 +20000"],
        ["valve_2 3"],
        ["pump_2 -20000"],
    ]


def test_a_small_syringe_is_never_asked_for_a_full_stroke_in_less_than_its_time() -> None:
    graph = chemputer(
        "flask_a:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:5 > waste_b:0", pump_ml=1
    )
    steps = steps_of(graph, "flask_a", "waste_b", "1 mL")
    assert steps[1][0]["parameters"]["rate_ul_s"] == 50.0


def test_a_rate_that_is_asked_for_is_the_rate() -> None:
    rates = {"rate": "30 mL/min", "draw_rate": "6 mL/min", "push_rate": "12 mL/min"}
    steps = steps_of(TWO, "flask_a", "reactor_b", "1 mL", **rates)
    moved = [command["parameters"].get("rate_ul_s") for group in steps[1::2] for command in group]
    assert moved == [100.0, 500.0, 500.0, 200.0]


@pytest.mark.parametrize(
    ("line", "subjects"),
    [
        (b"", [""]),
        (b"garbage", [""]),
        (b"[1]", [""]),
        (b'{"from":"a"}', ["to", "volume"]),
        (b'{"from":"a","to":1,"volume":"1 mL"}', ["to"]),
        (b'{"from":"a","to":"b","volume":"1 mL","speed":3}', ["speed"]),
        (b'{"from":"a","to":"b","volume":5}', ["volume"]),
        (b'{"from":"a","to":"b","volume":"two drops"}', ["volume"]),
        (b'{"from":"a","to":"b","volume":"1,5 mL"}', ["volume"]),
        (b'{"from":"a","to":"b","volume":"-5 mL"}', ["volume"]),
        (b'{"from":"a","to":"b","volume":"1.500,5 mL"}', ["volume"]),
        (b'{"from":"a","to":"b","volume":"1e99999999999999999999 mL"}', ["volume"]),
        (b'{"from":"a","to":"b","volume":null}', ["volume"]),
        (b'{"from":"a","to":"b","volume":"1 mL","through":"c"}', ["through"]),
        (b'{"from":"a","to":"b","volume":"1 mL","rate":"1e-12 mL/min"}', ["rate"]),
        (b'{"from":"a","to":"b","volume":"1 mL","rate":"0 mL/min"}', ["rate"]),
        (b'{"from":"a","from":"c","to":"b","volume":"1 mL"}', [""]),
        (b'{"from":"\xff","to":"b","volume":"1 mL"}', [""]),
        (b"[" * 5000, [""]),
        (b'{"from":"' + b"x" * 70_000 + b'"}', [""]),
    ],
)
def test_a_malformed_line_is_told_field_by_field(line: bytes, subjects: list[str]) -> None:
    answer = compile_line(rig_of(TWO), line)
    assert answer["ok"] is False
    assert [finding["subject"] for finding in answer["findings"]] == subjects
    assert all(f["code"].startswith(("request.", "unit.")) for f in answer["findings"])
    assert all(set(f) == {"code", "message", "subject"} for f in answer["findings"])


def test_a_field_that_is_null_is_left_out() -> None:
    fields = ("from_port", "to_port", "through", "rate", "draw_rate", "push_rate")
    plain = steps_of(TWO, "flask_a", "reactor_b", "1 mL")
    assert steps_of(TWO, "flask_a", "reactor_b", "1 mL", **dict.fromkeys(fields)) == plain


def test_ends_that_are_no_vessels_are_refused() -> None:
    assert codes_of(TWO, "flask_a", "pump_1") == ["plan.not_a_vessel"]
    assert codes_of(TWO, "valve_1", "reactor_b") == ["plan.not_a_vessel"]
    assert codes_of(TWO, "flask_a", "nobody") == ["plan.unknown_vessel"]
    assert codes_of(TWO, "flask_a", "flask_a") == ["plan.same_vessel"]


def test_a_volume_of_millions_of_strokes_is_refused_without_making_one() -> None:
    assert codes_of(TWO, "flask_a", "reactor_b", "9000 L") == ["plan.too_many_strokes"]


def test_a_flask_that_nothing_leads_into_is_refused() -> None:
    answer = ask(TWO, "reactor_b", "flask_a", "1 mL")
    (finding,) = answer["findings"]
    assert (finding["code"], finding["subject"]) == ("plan.no_tube", "flask_a")
    assert "conducts one way" in finding["message"]


def test_a_break_that_is_met_twice_is_told_once() -> None:
    graph = chemputer(
        "flask_a:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:5 > waste_b:0",
        "valve_1:-1 = pump_2:0",
    )  # fmt: skip
    assert codes_of(graph, "flask_a", "waste_b") == ["plan.tee"]


def test_two_outer_ports_of_a_valve_are_never_joined() -> None:
    graph = chemputer(
        "flask_a:0 > valve_1:0", "valve_1:1 > valve_2:0", "valve_2:-1 = pump_1:0",
        "valve_2:1 > waste_b:0",
    )  # fmt: skip
    answer = ask(graph, "flask_a", "waste_b", "1 mL")
    (finding,) = answer["findings"]
    assert (finding["code"], finding["subject"]) == ("plan.valve_cannot_join", "valve_1")
    assert "'0'" in finding["message"]
    assert "'1'" in finding["message"]


def test_no_transfer_leads_through_a_vessel_or_an_unasked_cartridge() -> None:
    graph = chemputer(
        "flask_a:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:1 > cartridge_c:in",
        "cartridge_c:out > reactor_b:0", "valve_1:2 > reactor_d:0", "reactor_d:1 > waste_e:0",
    )  # fmt: skip
    assert codes_of(graph, "flask_a", "waste_e") == ["plan.vessel_between"]
    assert codes_of(graph, "flask_a", "reactor_b") == ["plan.no_conductor"]
    steps = steps_of(graph, "flask_a", "reactor_b", "1 mL", through=["cartridge_c"])
    assert told(steps) == [["valve_1 0"], ["pump_1 +1000"], ["valve_1 1"], ["pump_1 -1000"]]
    assert codes_of(graph, "flask_a", "reactor_b", through=["reactor_d"]) == ["plan.no_conductor"]


def test_liquid_that_nothing_moves_is_refused() -> None:
    graph = chemputer("flask_a:0 > valve_1:0", "valve_1:-1 > reactor_b:0")
    assert codes_of(graph, "flask_a", "reactor_b") == ["plan.no_pump"]


def test_a_vacuum_line_is_given_no_liquid() -> None:
    graph = chemputer("flask_a:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:3 > vacuum_v:0")
    assert codes_of(graph, "flask_a", "vacuum_v") == ["plan.not_a_vessel"]


def test_a_valve_whose_port_nobody_names_is_not_turned() -> None:
    graph = chemputer("flask_a:0 > valve_1:", "pump_1:0 = valve_1:-1", "valve_1:3 > waste_b:0")
    assert codes_of(graph, "flask_a", "waste_b") == ["plan.port_unnamed"]


def test_a_port_at_which_two_flasks_would_be_drawn_is_refused() -> None:
    graph = chemputer(
        "flask_a:0 > valve_1:0", "flask_c:0 > valve_1:0", "pump_1:0 = valve_1:-1",
        "valve_1:3 > waste_b:0",
    )  # fmt: skip
    answer = ask(graph, "flask_a", "waste_b", "1 mL")
    assert [f["code"] for f in answer["findings"]] == ["plan.tee"]
    assert "flask_a and flask_c" in answer["findings"][0]["message"]


def test_one_port_may_draw_from_one_vessel_and_push_to_another() -> None:
    # The tubes conduct as they are drawn: what is drawn comes from the rotavap alone.
    graph = chemputer(
        "rotavap_r:collect > valve_1:2", "valve_1:2 > waste_b:0", "pump_1:0 = valve_1:-1",
        "valve_1:3 > reactor_d:0", "flask_a:0 > valve_1:4",
    )  # fmt: skip
    assert steps_of(graph, "rotavap_r", "reactor_d", "1 mL")
    assert steps_of(graph, "flask_a", "waste_b", "1 mL")


def test_a_port_that_the_class_does_not_have_is_a_finding() -> None:
    graph = chemputer("flask_a:0 > valve_1:6", "pump_1:0 = valve_1:-1", "valve_1:3 > waste_b:0")
    assert "graph.bad_port" in codes_of(graph, "flask_a", "waste_b")
    assert codes_of(graph, "flask_a", "valve_1") == ["plan.not_a_vessel", "graph.bad_port"]


def test_a_syringe_of_unknown_size_is_not_used() -> None:
    graph = chemputer("flask_a:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:3 > waste_b:0")
    for node in graph["nodes"]:
        node.pop("max_volume", None)
    assert codes_of(graph, "flask_a", "waste_b") == ["plan.unknown_syringe"]


def test_the_usual_port_of_a_vessel_comes_first_and_another_only_when_asked() -> None:
    graph = chemputer(
        "separator_s:top > valve_1:0", "separator_s:bottom > valve_1:4", "pump_1:0 = valve_1:-1",
        "valve_1:3 > waste_b:0",
    )  # fmt: skip
    assert told(steps_of(graph, "separator_s", "waste_b", "1 mL"))[0] == ["valve_1 4"]
    asked = steps_of(graph, "separator_s", "waste_b", "1 mL", from_port="top")
    assert told(asked)[0] == ["valve_1 0"]
    assert codes_of(graph, "separator_s", "waste_b", from_port="left") == ["plan.unknown_port"]
    assert codes_of(graph, "separator_s", "waste_b", to_port="1") == ["plan.unknown_port"]


def test_a_lab_of_ours_is_a_rig_too() -> None:
    raw = (Path(__file__).parents[3] / "fixtures/labs/starter/lab.json").read_bytes()
    line = b'{"from": "acid", "to": "flask_1", "volume": "10 mL"}'
    answer = compile_line(read_rig(raw), line)
    stroke = [["valve_1 2"], ["pump_1 +5000"], ["valve_1 4"], ["pump_1 -5000"]]
    assert told(answer["steps"]) == 2 * stroke


def uni_lab(*links: tuple[str, str, dict[str, str]], **classes: str) -> dict[str, Any]:
    nodes = [
        {"id": key, "class": word, "type": "device" if word else "container",
         "config": {"max_volume": 25.0}}
        for key, word in classes.items()
    ]  # fmt: skip
    drawn = [
        {"id": f"l{place}", "source": one, "target": two, "port": ports, "type": "fluid"}
        for place, (one, two, ports) in enumerate(links)
    ]
    return {"nodes": nodes, "links": drawn}


def test_a_solenoid_is_opened_for_its_stroke_and_closed_after_it() -> None:
    graph = uni_lab(
        ("p", "v", {"p": "transferpump", "v": "transferpump"}),
        ("v", "a", {"v": "1", "a": "top"}),
        ("v", "s", {"v": "2", "s": "in"}),
        ("s", "b", {"s": "out", "b": "top"}),
        p="virtual_transfer_pump", v="virtual_multiway_valve", s="solenoid_valve", a="", b="",
    )  # fmt: skip
    steps = steps_of(graph, "a", "b", "1 mL")
    assert told(steps) == [
        ["v 1"], ["p +1000"], ["v 2"], ["s open"], ["p -1000"], ["s close"],
    ]  # fmt: skip
    check(Plumbing(graph), steps, "a", "b", 1000.0)
    back = told(steps_of(graph, "b", "a", "1 mL"))
    assert back == [["v 2"], ["s open"], ["p +1000"], ["s close"], ["v 1"], ["p -1000"]]


def test_a_pump_with_a_valve_of_its_own_is_turned_itself() -> None:
    graph = uni_lab(
        ("p", "a", {"p": "1", "a": "top"}), ("p", "b", {"p": "I2", "b": "top"}),
        p="syringe_pump_with_valve.runze.SY03B-T08", a="", b="",
    )  # fmt: skip
    steps = steps_of(graph, "a", "b", "1 mL")
    assert told(steps) == [["p 1"], ["p +1000"], ["p I2"], ["p -1000"]]


def test_a_serial_bus_carries_no_liquid() -> None:
    # The two pumps share a bus and no tube.
    graph = uni_lab(
        ("p", "a", {"p": "1", "a": "top"}), ("q", "b", {"q": "1", "b": "top"}),
        p="syringe_pump_with_valve", q="syringe_pump_with_valve", bus="serial", a="", b="",
    )  # fmt: skip
    for key in "pq":
        link = {
            "source": "bus",
            "target": key,
            "type": "communication",
            "port": {"bus": "", key: ""},
        }
        graph["links"].append(link)
    answer = ask(graph, "a", "b", "1 mL")
    assert answer["findings"][0]["code"] == "plan.wrong_medium"
    assert answer["findings"][0]["subject"] == "p"
    assert "communication" in answer["findings"][0]["message"]


def test_a_syringe_with_many_tubes_and_no_valve_cannot_choose() -> None:
    graph = uni_lab(
        ("p", "a", {"p": "inlet", "a": "top"}), ("p", "b", {"p": "outlet", "b": "top"}),
        p="virtual_transfer_pump", a="", b="",
    )  # fmt: skip
    assert codes_of(graph, "a", "b") == ["plan.ambiguous_port"]


def test_an_injection_valve_joins_the_pairs_of_a_position() -> None:
    graph = uni_lab(
        ("p", "v", {"p": "x", "v": "1"}), ("v", "a", {"v": "2", "a": "top"}),
        ("v", "b", {"v": "6", "b": "top"}),
        p="virtual_transfer_pump", v="injection_valve", a="", b="",
    )  # fmt: skip
    joins = {
        "load": [["1", "2"], ["3", "4"], ["5", "6"]],
        "inject": [["2", "3"], ["4", "5"], ["6", "1"]],
    }
    graph["nodes"][1]["config"]["joins"] = joins
    steps = steps_of(graph, "a", "b", "1 mL")
    assert told(steps) == [["v load"], ["p +1000"], ["v inject"], ["p -1000"]]


@st.composite
def rigs(draw: st.DrawFn) -> tuple[dict[str, Any], list[str]]:
    """Draw a backbone of valves, most with a pump, vessels at random ports, some flaws."""
    count = draw(st.integers(1, 6))
    chance = random.Random(draw(st.integers(0, 10**6)))
    free = {n: [str(port) for port in range(6)] for n in range(count)}
    links = []
    for number in range(count):
        if chance.random() < 0.85:
            links.append(f"pump_{number}:0 = valve_{number}:-1")
        else:
            links.append(f"reactor_c{number}:0 = valve_{number}:-1")
        if number:
            ends = chance.randrange(number)
            if free[ends]:
                one, two = free[ends].pop(), free[number].pop(0)
                links.append(f"valve_{ends}:{one} = valve_{number}:{two}")
    vessels = [f"reactor_c{n}" for n in range(count) if f"reactor_c{n}:0 = valve_{n}:-1" in links]
    for place in range(draw(st.integers(2, 8))):
        number = chance.randrange(count)
        ports = free[number] if chance.random() < 0.9 else ["0", "1"]
        if not ports:
            continue
        port = ports.pop() if ports is free[number] else chance.choice(ports)
        vessels.append(f"reactor_{place}")
        sign = chance.choice("===>")
        ends_of = (f"reactor_{place}:{chance.randrange(3)}", f"valve_{number}:{port}")
        links.append(f" {sign} ".join(ends_of if chance.random() < 0.5 else ends_of[::-1]))
    return chemputer(*links, pump_ml=chance.choice((5, 10, 25))), vessels


@settings(max_examples=60, deadline=None)
@given(drawn=rigs(), ml=st.sampled_from((0.1, 10.0, 60.0)))
def test_every_plan_on_a_random_rig_moves_the_amount_and_nothing_else(
    drawn: tuple[dict[str, Any], list[str]], ml: float
) -> None:
    graph, vessels = drawn
    rig, plumbing = rig_of(graph), Plumbing(graph)
    for source in vessels:
        for target in vessels:
            line = json.dumps({"from": source, "to": target, "volume": f"{ml} mL"}).encode()
            answer = compile_line(rig, line)
            if answer["ok"]:
                check(plumbing, answer["steps"], source, target, ml * 1000)
            else:
                assert answer["findings"]


def test_the_interpreter_can_fail() -> None:
    steps = steps_of(TWO, "flask_a", "reactor_b", "1 mL")
    plumbing = Plumbing(TWO)
    check(plumbing, steps, "flask_a", "reactor_b", 1000.0)
    for spoiled in (steps[:-1], steps[1:], steps[:2] + steps[4:], steps + steps[-1:]):
        with pytest.raises(WrongError):
            check(plumbing, spoiled, "flask_a", "reactor_b", 1000.0)


def test_the_order_of_the_file_does_not_matter() -> None:
    graph = chemputer(
        *(f"flask_a:{n} > valve_1:{n}" for n in (2, 0, 1)), "pump_1:0 = valve_1:-1",
        "valve_1:5 > waste_b:0", "valve_1:4 > waste_b:1",
    )  # fmt: skip
    first = steps_of(graph, "flask_a", "waste_b", "1 mL")
    graph["links"].reverse()
    graph["nodes"].reverse()
    assert steps_of(graph, "flask_a", "waste_b", "1 mL") == first
    assert told(first)[0] == ["valve_1 0"]
    assert told(first)[2] == ["valve_1 4"]
