"""The command, as a process, where no database answers."""

from __future__ import annotations

import gzip
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.domain.proof.bench import GRAPH, plan
from tests.domain.proof.plans import GAS, PIPELINED, RIGHT

ROOT = Path(__file__).parents[3]


def run(folder: Path, text: str, *more: str, graph: bytes = GRAPH) -> tuple[int, str, str]:
    (folder / "graph.json").write_bytes(graph)
    (folder / "plan.json").write_text(text)
    paths = (str(folder / "graph.json"), str(folder / "plan.json"))
    done = subprocess.run(
        [sys.executable, "manage.py", "interpret", *paths, *more],
        cwd=ROOT,
        env={**os.environ, "DATABASE_URL": "postgresql://nobody@127.0.0.1:1/nothing"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return done.returncode, done.stdout.strip(), done.stderr


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_right_plan_is_exit_code_0(tmp_path: Path, *, wrapped: bool) -> None:
    right = RIGHT["heat"]
    text = json.dumps({"ok": True, "plan": right} if wrapped else right)
    assert run(tmp_path, text) == (0, "proved", "")


def test_a_wrong_plan_is_exit_code_2_with_every_finding(tmp_path: Path) -> None:
    code, stdout, _ = run(tmp_path, json.dumps(plan(GAS)), "--json")
    answer = json.loads(stdout)
    assert (code, answer["ok"]) == (2, False)
    assert {finding["code"] for finding in answer["findings"]} == {"interpret.left_running"}


def test_a_plan_of_the_wrong_form_is_exit_code_2(tmp_path: Path) -> None:
    code, stdout, stderr = run(tmp_path, "{}")
    assert (code, stdout) == (2, "not proved: 1 findings")
    assert "interpret.shape" in stderr


@pytest.mark.parametrize(
    ("text", "graph", "code"),
    [
        ("nonsense", GRAPH, "lab_file.json"),
        ("{}", b"{}", "lab_file.no_nodes"),
        ("{}", gzip.compress(GRAPH, mtime=0)[:40], "lab_file.gzip"),
    ],
)
def test_a_file_that_cannot_be_read_is_exit_code_1(
    tmp_path: Path, text: str, graph: bytes, code: str
) -> None:
    returned, stdout, _ = run(tmp_path, text, "--json", graph=graph)
    assert returned == 1
    assert json.loads(stdout)["findings"][0]["code"] == code


def test_a_file_that_is_not_there_is_exit_code_1(tmp_path: Path) -> None:
    code, _, stderr = run(tmp_path, "{}", "--request", str(tmp_path / "nothing"))
    assert (code, "cannot read" in stderr) == (1, True)


def test_answers_of_compile_transfers_are_judged_line_by_line(tmp_path: Path) -> None:
    request = {"from": "flask_water", "to": "reactor", "volume": "10 mL"}
    requests = tmp_path / "requests.jsonl"
    requests.write_text("\n".join(json.dumps(request) for _ in range(3)))
    right = {"ok": True, "steps": PIPELINED["actions"]}
    wrong = {"ok": True, "steps": PIPELINED["actions"][:-1]}
    refused = {"ok": False, "findings": []}
    lines = "\n".join(json.dumps(line) for line in (right, wrong, refused))
    code, stdout, _ = run(tmp_path, lines, "--request", str(requests), "--json")
    found = json.loads(stdout)["findings"]
    assert code == 2
    assert {finding["subject"] for finding in found} == {"line 2"}
    assert {f["code"] for f in found} == {"interpret.syringe_not_empty", "interpret.claim"}


def test_a_line_that_is_no_request_is_rightly_refused(tmp_path: Path) -> None:
    requests = tmp_path / "requests.jsonl"
    lines = ["nonsense", json.dumps({"from": "a", "to": "b", "volume": "1 mL", "through": 5})]
    requests.write_text("\n".join(lines))
    both = json.dumps({"ok": False, "findings": []})
    assert run(tmp_path, f"{both}\n{both}", "--request", str(requests))[:2] == (0, "proved")
    both = json.dumps({"ok": True, "steps": []})
    code, stdout, _ = run(tmp_path, f"{both}\n{both}", "--request", str(requests), "--json")
    found = [(finding["subject"], finding["code"]) for finding in json.loads(stdout)["findings"]]
    assert (code, found) == (2, [("line 1", "lab_file.json"), ("line 2", "interpret.shape")])
