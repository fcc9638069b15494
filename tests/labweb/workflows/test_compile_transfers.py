"""The command, as a process, where no database answers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.domain.recipes.rigs import chemputer

ROOT = Path(__file__).parents[3]
GRAPH = chemputer("flask_a:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:5 > waste_b:0")
GOOD = '{"from": "flask_a", "to": "waste_b", "volume": "60 mL"}'
INFEASIBLE = '{"from": "waste_b", "to": "flask_a", "volume": "60 mL"}'


def run(
    folder: Path, lines: str, graph: dict[str, Any] = GRAPH, *, piped: bool = False
) -> tuple[int, list[Any], str]:
    (folder / "graph.json").write_text(json.dumps(graph))
    (folder / "requests.jsonl").write_text(lines)
    requests = "-" if piped else str(folder / "requests.jsonl")
    done = subprocess.run(
        [sys.executable, "manage.py", "compile_transfers", str(folder / "graph.json"), requests],
        cwd=ROOT,
        env={**os.environ, "DATABASE_URL": "postgresql://nobody@127.0.0.1:1/nothing"},
        input=lines if piped else None,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return done.returncode, [json.loads(line) for line in done.stdout.splitlines()], done.stderr


def test_each_line_is_answered_in_order(tmp_path: Path) -> None:
    code, answers, _ = run(tmp_path, f"{GOOD}\n\nnonsense\n{INFEASIBLE}\n{GOOD}", piped=True)
    assert code == 2
    assert [answer["ok"] for answer in answers] == [True, False, False, False, True]
    codes = [f["code"] for answer in answers[1:4] for f in answer["findings"]]
    assert codes == ["request.malformed", "request.malformed", "plan.no_tube", "plan.no_tube"]


def test_all_compiled_is_exit_code_0(tmp_path: Path) -> None:
    code, (answer,), stderr = run(tmp_path, GOOD)
    assert (code, stderr) == (0, "")
    assert len(answer["steps"]) == 12
    assert answer["steps"][0] == [
        {"device": "valve_1", "action": "set_port", "parameters": {"port": "0"}}
    ]


def test_a_refused_graph_is_exit_code_1_and_every_line_is_told_why(tmp_path: Path) -> None:
    graph = {"nodes": [*GRAPH["nodes"], GRAPH["nodes"][0]], "links": GRAPH["links"]}
    code, answers, stderr = run(tmp_path, f"{GOOD}\n{GOOD}", graph)
    assert code == 1
    assert [a["findings"][0]["code"] for a in answers] == ["graph.duplicate_id"] * 2
    assert "flask_a" in stderr


@pytest.mark.parametrize("count", [8, 9, 40])
def test_a_graph_with_many_faults_answers_each_line_with_the_first_and_their_number(
    tmp_path: Path, count: int
) -> None:
    links = [
        {"id": f"l{n}", "source": "flask_a", "target": f"nowhere_{n}", "port": "(0,0)"}
        for n in range(count)
    ]
    graph = {"nodes": GRAPH["nodes"], "links": [*GRAPH["links"], *links]}
    code, answers, stderr = run(tmp_path, f"{GOOD}\n" * 50, graph)
    assert code == 1
    assert len(answers) == 50
    for answer in answers:
        told, last = answer["findings"][:8], answer["findings"][8:]
        assert [one["subject"] for one in told] == [f"l{n}" for n in range(8)]
        assert [one["code"] for one in last] == ["graph.more_findings"] * (count > 8)
        assert all(one["message"].startswith(f"{count - 8} more") for one in last)
    assert stderr.count("graph.dangling_link") >= count
    assert all(f"nowhere_{n}" in stderr for n in range(count))


def test_answers_that_cannot_be_written_are_exit_code_1(tmp_path: Path) -> None:
    (tmp_path / "graph.json").write_text(json.dumps(GRAPH))
    (tmp_path / "requests.jsonl").write_text(GOOD)
    command = [sys.executable, "manage.py", "compile_transfers"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*command, str(tmp_path / "graph.json"), str(tmp_path / "requests.jsonl")],
            cwd=ROOT,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=120,
            check=False,
        )
    assert done.returncode == 1
    assert "cannot write the answers: No space left on device" in done.stderr


@pytest.mark.parametrize(
    "words",
    [
        ["compile_transfers", "graph.json"],
        ["interpret"],
        ["compile_protocol", "recipe.xdl"],
        ["convert_graph", "in", "out", "--to", "nothing"],
        ["convert_protocol", "in", "out", "--speed"],
    ],
)
def test_words_that_a_command_does_not_understand_are_exit_code_1(words: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "manage.py", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert "usage: manage.py" in done.stderr
