"""`convert_protocol` writes a recipe in another form, or says why not; it asks no database."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from django.core.management import CommandError, call_command

from labweb.domain.workflows.workflow_file import parse_workflow
from tests.architecture.project import ROOT

RECIPE = """<?xdl version="0.4.0" ?>
<Synthesis>
  <Hardware><Component id="reactor_1" type="reactor"/></Hardware>
  <Reagents><Reagent id="water"/></Reagents>
  <Procedure>
    <!-- first the water -->
    <Add vessel="reactor_1" reagent="water" volume="5 ml" comment="slowly"/>
    <HeatChill vessel="reactor_1" temp="60 \u00b0C" time="10 min"/>
    <Repeat repeats="2"><Wait time="1 min"/></Repeat>
    %s
  </Procedure>
</Synthesis>
"""


def convert(tmp_path: Path, steps: str, *options: str) -> str:
    source, target = tmp_path / "in.xdl", tmp_path / "out"
    source.write_text(RECIPE % steps, encoding="utf-8")
    call_command("convert_protocol", str(source), str(target), *options)
    return target.read_text("utf-8")


def refusal(tmp_path: Path, capsys: pytest.CaptureFixture[str], *args: str) -> list[dict[str, Any]]:
    with pytest.raises(CommandError) as caught:
        convert(tmp_path, *args, "--json")
    assert caught.value.returncode == 2
    assert not (tmp_path / "out").exists()
    findings: list[dict[str, Any]] = json.loads(capsys.readouterr().out)["findings"]
    return findings


@pytest.mark.parametrize("form", ["xdl-0.3", "xdl-0.5", "xdl-1", "xdl-2.0"])
def test_a_recipe_keeps_its_comments_in_every_version(tmp_path: Path, form: str) -> None:
    text = convert(tmp_path, "", "--to", form)
    assert "<!-- first the water -->" in text
    assert ('name="water"' in text) == (form != "xdl-0.3")


def test_json_and_back_is_the_same_recipe(tmp_path: Path) -> None:
    first = convert(tmp_path, "", "--to", "json")
    (tmp_path / "in.json").write_text(first, encoding="utf-8")
    call_command(
        "convert_protocol", str(tmp_path / "in.json"), str(tmp_path / "back"), "--to", "json"
    )
    assert json.loads((tmp_path / "back").read_text("utf-8")) == json.loads(first)


def test_a_recipe_of_known_steps_becomes_a_workflow(tmp_path: Path) -> None:
    workflow = parse_workflow(json.loads(convert(tmp_path, "", "--to", "workflow")))
    kinds = [step.kind for step in workflow.steps]
    assert kinds == ["transfer", "start_stir", "heat_chill", "wait", "wait", "stop_stir"]
    assert workflow.steps[0].params == {
        "source": "@water",
        "target": "@reactor_1",
        "volume": "5 mL",
    }
    assert workflow.steps[0].note == "slowly"
    # The recipe names no speed, so the one that is taken is told.
    assert workflow.steps[1].params["stir_speed"] == "250 rpm"
    assert "250 RPM" in workflow.steps[1].note
    ids = [step.id for step in workflow.steps]
    assert [(edge.source, edge.target) for edge in workflow.edges] == list(pairwise(ids))


def test_queues_become_branches_and_meet_again(tmp_path: Path) -> None:
    steps = (
        '<Wait time="1 s" queue="a"/><Wait time="2 s" queue="b"/><Wait time="3 s" queue="a"/>'
        '<Wait time="4 s"/>'
    )
    workflow = parse_workflow(json.loads(convert(tmp_path, steps, "--to", "workflow")))
    edges = {(edge.source, edge.target) for edge in workflow.edges}
    assert {("s5", "s6"), ("s5", "s7"), ("s6", "s8"), ("s8", "s9"), ("s7", "s9")} <= edges


@pytest.mark.parametrize(
    ("steps", "code"),
    [
        ('<StartPurge vessel="reactor_1"/>', "xdl.not_in_workflow"),
        ('<Async on_finish="tell"><Wait time="1 s"/></Async>', "xdl.not_in_workflow"),
        (
            '<Add vessel="reactor_1" reagent="water" volume="1 mL" dropwise="True"/>',
            "xdl.left_open",
        ),
        ('<Add vessel="reactor_1" reagent="water" volume="all"/>', "xdl.range_not_exact"),
        ('<Wait time="overnight"/>', "xdl.range_not_exact"),
        ('<HeatChill vessel="reactor_1" temp="20-25 \u00b0C" time="1 h"/>', "xdl.range_not_exact"),
        ('<Add vessel="reactor_1" reagent="water" volume="0.0000001 mL"/>', "unit.off_grid"),
        ('<Repeat repeats="999999999"><Wait time="1 s"/></Repeat>', "protocol.too_many_steps"),
        ('<Add vessel="beaker" reagent="water" volume="1 mL"/>', "xdl.vessel_not_declared"),
    ],
)
def test_what_a_workflow_cannot_say_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], steps: str, code: str
) -> None:
    assert code in {
        finding["code"] for finding in refusal(tmp_path, capsys, steps, "--to", "workflow")
    }


def test_a_name_that_is_no_key_is_bound_by_hand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "in.xdl"
    source.write_text((RECIPE % "").replace("water", "pure water"), encoding="utf-8")
    target = str(tmp_path / "out")
    with pytest.raises(CommandError, match="pure water"):
        call_command("convert_protocol", str(source), target, "--to", "workflow")
    bound = ("--bind", "pure water=flask_1")
    call_command("convert_protocol", str(source), target, "--to", "workflow", *bound)
    workflow = parse_workflow(json.loads((tmp_path / "out").read_text("utf-8")))
    assert workflow.steps[0].params["source"] == "@flask_1"


def test_a_version_that_cannot_say_it_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (finding,) = refusal(tmp_path, capsys, '<Wait time="1 s" queue="a"/>', "--to", "xdl-1")
    assert finding["code"] == "xdl.not_in_version"
    assert finding["context"]["line"] == 10


def test_a_file_that_is_there_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    with pytest.raises(CommandError, match="is there already"):
        convert(tmp_path, "")
    assert (tmp_path / "out").read_text() == "mine"


def test_it_runs_where_no_database_is(tmp_path: Path) -> None:
    (tmp_path / "in.xdl").write_text(RECIPE % "", encoding="utf-8")
    nowhere = {"DATABASE_URL": "postgres://nobody@127.0.0.1:1/none", "PYTHONPATH": str(ROOT)}
    program = [sys.executable, "manage.py", "convert_protocol"]
    files = [str(tmp_path / "in.xdl"), str(tmp_path / "out")]
    done = subprocess.run(
        [*program, *files],
        cwd=ROOT,
        env=os.environ | nowhere,
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    missing = [str(tmp_path / "none"), str(tmp_path / "other")]
    refused = subprocess.run(
        [*program, *missing], cwd=ROOT, env=os.environ | nowhere, check=False, capture_output=True
    )
    assert refused.returncode == 1


def test_a_graph_that_is_none_is_exit_code_1(tmp_path: Path) -> None:
    (tmp_path / "graph.json").write_text("{}")
    with pytest.raises(CommandError, match=r"lab_file\.no_nodes") as caught:
        convert(tmp_path, "", "--to", "workflow", "--lab", str(tmp_path / "graph.json"))
    assert caught.value.returncode == 1
