"""Answers of a compiler, right and wrong, and how each is counted."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.judge.__main__ import main
from tests.judge.bench import RIGHT, bench, document
from tests.judge.harness import Tally, ask_compiler, judge_all, pairs
from tests.judge.oracle import Oracle
from tests.judge.reading import read_json
from tests.judge.verdict import Mark, Verdict, judge
from tests.judge.witness import move, set_port

ASKED: dict[str, object] = {"from": "A", "to": "B", "volume": "15 mL"}
APART: dict[str, object] = {"from": "A", "to": "H", "volume": "15 mL"}
WITNESS = (sys.executable, "-m", "tests.judge", "--witness")


ORACLE = Oracle(bench())


def verdict(line: dict[str, object], answer: object) -> Verdict:
    return judge(ORACLE, line, answer)


def a_finding(**keys: object) -> dict[str, object]:
    return {"code": "route.none", "message": "no hose", "subject": "S2", **keys}


def a_refusal(**keys: object) -> dict[str, object]:
    return {"ok": False, "findings": [a_finding(**keys)]}


def test_a_right_plan_is_right() -> None:
    answer = {"ok": True, "steps": RIGHT["a_to_b"]()[1]}
    assert verdict(ASKED, answer) == Verdict(Mark.RIGHT_PLAN)


@pytest.mark.parametrize("answer", [None, [], "ok", {}, {"ok": "yes"}, {"ok": True}, {"ok": 1}])
def test_an_answer_without_form_is_wrong(answer: object) -> None:
    assert verdict(ASKED, answer).code == "form"


def test_a_refusal_of_what_can_be_done_is_wrong() -> None:
    assert verdict(ASKED, a_refusal()).code == "refused-feasible"


def test_a_plan_for_what_cannot_be_done_is_wrong() -> None:
    answer = {"ok": True, "steps": RIGHT["a_to_b"]()[1]}
    found = verdict(APART, answer)
    assert (found.mark, found.code) == (Mark.WRONG, "claims-infeasible")
    assert verdict(APART, {"ok": True, "steps": []}).code == "claims-infeasible"


def test_a_plan_that_runs_against_the_edges_is_told_from_other_wrong_ones() -> None:
    """f1 gives only, f2 takes only; the plan goes the other way."""
    nodes = [{"id": "v", "class": "ChemputerValve"}]
    nodes += [{"id": name, "class": "ChemputerFlask"} for name in ("f1", "f2")]
    pump = {"id": "p", "class": "ChemputerPump", "max_volume": 5}
    edges = [("f1", "v", "(0,1)"), ("v", "f2", "(2,0)"), ("v", "p", "(-1,0)"), ("p", "v", "(0,-1)")]
    links = [{"source": a, "target": b, "port": port} for a, b, port in edges]
    oracle = Oracle(read_json({"nodes": [*nodes, pump], "links": links}))
    plan = [[set_port("v", "1")], [move("p", "aspirate", 1000.0)]]
    plan += [[set_port("v", "2")], [move("p", "dispense", 1000.0)]]
    there: dict[str, object] = {"from": "f1", "to": "f2", "volume": "1 mL"}
    back: dict[str, object] = {"from": "f2", "to": "f1", "volume": "1 mL"}
    assert judge(oracle, there, {"ok": True, "steps": plan}).mark is Mark.RIGHT_PLAN
    plan[0], plan[2] = plan[2], plan[0]
    assert judge(oracle, back, {"ok": True, "steps": plan}).code == "against-direction"


@pytest.mark.parametrize("subject", ["S2", "P3", "I", "V1", "V3", "A", "H", "G"])
def test_a_refusal_that_names_the_break_on_either_side_is_right(subject: str) -> None:
    found = verdict(APART, a_refusal(subject=subject))
    is_near = subject in {"S2", "P3", "I", "V1", "V3"}
    assert found.mark is (Mark.RIGHT_REFUSAL if is_near else Mark.WRONG), found


def test_a_refusal_that_names_no_place_is_wrong() -> None:
    found = verdict(APART, a_refusal(message="no", subject="request"))
    assert found.code == "break-not-named"


@pytest.mark.parametrize("key", ["code", "message", "subject"])
@pytest.mark.parametrize("value", [None, "", 3])
def test_a_refusal_needs_findings_with_all_keys(key: str, value: object) -> None:
    assert verdict(APART, a_refusal(**{key: value})).code == "form"
    assert verdict(APART, {"ok": False, "findings": []}).code == "form"
    assert verdict(APART, {"ok": False}).code == "form"


@pytest.mark.parametrize(
    "line",
    [
        {"from": "A", "to": "A", "volume": "1 mL"},
        {"from": "A", "to": "nobody", "volume": "1 mL"},
        {"from": "P1", "to": "A", "volume": "1 mL"},
        {"from": "A", "to": "B", "volume": "two drops"},
        {"from": "A", "to": "B", "volume": "-5 mL"},
        {"from": "A", "to": "B", "volume": "0 mL"},
        {"from": "A", "to": "B", "volume": "1,5 mL"},
        {"from": "A", "to": "B", "volume": "0.1 nL"},
        {"from": "A", "to": "B", "volume": 15},
        {"from": "A", "to": "B"},
        {"from": "A", "to": "B", "volume": "1 mL", "from_port": "side"},
    ],
)
def test_a_request_that_nobody_can_do_has_to_be_refused(line: dict[str, object]) -> None:
    answer: dict[str, Any] = {"ok": True, "steps": RIGHT["a_to_b"]()[1]}
    assert verdict(line, answer).code == "claims-infeasible"
    named = a_refusal(subject=f"{line['from']} {line.get('to')} V1")
    assert verdict(line, named).mark is Mark.RIGHT_REFUSAL


_WORDS = st.sampled_from(
    [
        "ok",
        "steps",
        "findings",
        "device",
        "action",
        "parameters",
        "P1",
        "V1",
        "aspirate",
        "wait",
        "open",
        "code",
        "set_port",
        "port",
        "volume_ul",
        "rate_ul_s",
        "duration_s",
        "1",
    ]
)
_LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.decimals() | _WORDS
_JSON = st.recursive(
    _LEAVES, lambda inner: st.lists(inner) | st.dictionaries(_WORDS, inner), max_leaves=8
)
_ACTS = st.fixed_dictionaries(
    {}, optional={"device": _LEAVES, "action": _WORDS, "parameters": _JSON}
)


@pytest.mark.timeout(600)
@given(st.lists(st.lists(_ACTS, max_size=3), max_size=3) | _JSON, _JSON)
def test_nothing_that_a_compiler_says_breaks_the_judge(steps: object, findings: object) -> None:
    for answer in ({"ok": True, "steps": steps}, {"ok": False, "findings": findings}, steps):
        for line in (ASKED, APART):
            assert verdict(line, answer).mark in {Mark.WRONG, Mark.RIGHT_REFUSAL}


def test_a_missing_and_a_superfluous_answer_are_wrong() -> None:
    right = {"ok": True, "steps": RIGHT["a_to_b"]()[1]}
    assert judge_all(bench(), "bench", [ASKED, ASKED], [right]).codes == {"form": 1}
    assert judge_all(bench(), "bench", [ASKED], [right, right]).wrong == 1


def test_examples_say_where_and_what() -> None:
    tally = Tally()
    tally.add("rig", ASKED, Verdict(Mark.WRONG, "no-path", "step 1: nothing"))
    assert tally.report().endswith(
        'rig: {"from": "A", "to": "B", "volume": "15 mL"}: no-path: step 1: nothing'
    )


def test_a_compiler_is_asked_in_a_process_of_its_own(tmp_path: Path) -> None:
    graph = tmp_path / "bench.json"
    graph.write_text(json.dumps(document()), "utf-8")
    lines = pairs(bench())
    answers = ask_compiler(graph, lines, tmp_path, command=WITNESS)
    tally = judge_all(bench(), "bench", lines, answers)
    assert tally.marks == {Mark.RIGHT_PLAN: (8 * 7 + 2) * 3, Mark.RIGHT_REFUSAL: 156}


def test_a_compiler_that_says_nothing_is_an_error(tmp_path: Path) -> None:
    graph = tmp_path / "bench.json"
    graph.write_text(json.dumps(document()), "utf-8")
    with pytest.raises(AssertionError, match="1 requests, 0 answers"):
        ask_compiler(graph, [ASKED], tmp_path, command=(sys.executable, "-c", "pass"))


def test_the_command_line_judges_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = {name: tmp_path / name for name in ("graph.json", "asked.jsonl", "answered.jsonl")}
    graph, asked, answered = paths.values()
    graph.write_text(json.dumps(document()), "utf-8")
    asked.write_text(json.dumps(ASKED) + "\n", "utf-8")
    steps = RIGHT["a_to_b"]()[1]
    answered.write_text(json.dumps({"ok": True, "steps": steps}) + "\n", "utf-8")
    assert main([str(path) for path in paths.values()]) == 0
    steps[3] = [move("P1", "dispense", 1.0)]
    answered.write_text(json.dumps({"ok": True, "steps": steps}) + "\n", "utf-8")
    assert main([str(path) for path in paths.values()]) == 1
    assert "wrong" in capsys.readouterr().out
    assert main([str(graph), str(asked), "--oracle"]) == 0
    assert '"answer": "feasible"' in capsys.readouterr().out
    assert main([str(graph), "--pairs"]) == 0
    assert capsys.readouterr().out.count("\n") == len(pairs(bench()))


def test_the_command_line_writes_an_invented_rig(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path), "--invent", "3"]) == 0
    graph = Path(capsys.readouterr().out.strip())
    assert main([str(graph), str(graph.with_suffix(".jsonl")), "--witness"]) == 0
    answers = graph.with_name("answers.jsonl")
    answers.write_text(capsys.readouterr().out, "utf-8")
    assert main([str(graph), str(graph.with_suffix(".jsonl")), str(answers)]) == 0
