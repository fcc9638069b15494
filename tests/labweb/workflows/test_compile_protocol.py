"""The command, as a process, where no database answers."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from django.core.management import CommandError, call_command

from labweb.domain.recipes.recipe_to_plan import compile_recipe
from tests.domain.recipes.plans import bench, recipe
from tests.domain.recipes.test_wastes import clean, stirred, two_wastes
from tests.domain.recipes.test_wastes import text as recipe_of_wastes

ROOT = Path(__file__).parents[3]
COMMAND = "labweb.workflows.management.commands.compile_protocol"
ADD = 'Add vessel="reactor" reagent="water" volume="60 mL"'


def run(folder: Path, text: str, *options: str, graph: str = "") -> tuple[int, str, str]:
    (folder / "graph.json").write_text(graph or json.dumps(bench()))
    (folder / "recipe.xdl").write_text(text)
    done = subprocess.run(
        [
            *(sys.executable, "manage.py", "compile_protocol", str(folder / "recipe.xdl")),
            *("--lab", str(folder / "graph.json"), *options),
        ],
        cwd=ROOT,
        env={**os.environ, "DATABASE_URL": "postgresql://nobody@127.0.0.1:1/nothing"},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


def test_a_plan_is_exit_code_0_and_names_its_files(tmp_path: Path) -> None:
    code, out, err = run(tmp_path, recipe(ADD), "--json")
    assert (code, err) == (0, "")
    answer: dict[str, Any] = json.loads(out)
    assert answer["ok"]
    plan = answer["plan"]
    assert plan["plan"] == 1
    assert plan["recipe"]["id"] == "recipe"
    raw = (tmp_path / "graph.json").read_bytes()
    assert plan["graph_sha256"] == hashlib.sha256(raw).hexdigest()


def test_a_recipe_on_a_rig_with_two_wastes_goes_by_what_is_declared(tmp_path: Path) -> None:
    graph = json.dumps(stirred(two_wastes()))
    text = recipe_of_wastes(clean("dcm"), clean("water"))
    code, out, err = run(tmp_path, text, graph=graph)
    assert (code, out) == (2, "")
    assert "plan.unknown_chemistry" in err
    stated: dict[str, Any] = {"schema": "labweb.declared/1"}
    stated["groups"] = {"dcm": ["halogenated"], "water": ["water"], "acetone": ["ketone"]}
    (tmp_path / "declared.json").write_text(json.dumps(stated))
    options = ("--declared", str(tmp_path / "declared.json"), "--rinse", "acetone", "--json")
    code, out, err = run(tmp_path, text, *options, graph=graph)
    assert (code, err) == (0, "")
    steps = json.loads(out)["plan"]["steps"]
    does = [step["does"] for step in steps]
    poured = [one["to"] for one in does if one["kind"] == "transfer" and "lot" not in one]
    assert poured == ["waste_organic", "waste_aqueous"]
    assert {one["to"] for one in does if one["kind"] == "clean"} == {"waste_organic"}


def test_a_table_for_people_has_time_amounts_and_places(tmp_path: Path) -> None:
    code, out, _ = run(tmp_path, recipe(ADD))
    assert code == 0
    assert "60.000 mL  water" in out
    assert "By hand    1 times" in out
    assert "Add (line 1): transfer" in out


def test_a_refusal_is_exit_code_2_with_all_findings(tmp_path: Path) -> None:
    text = recipe(ADD, 'Stir vessel="flask_spare" time="1 min"', 'Purge vessel="reactor"')
    code, out, err = run(tmp_path, text, "--json", "--bind", "water=flask_ether")
    assert code == 2
    findings = json.loads(out)["findings"]
    assert {f["code"] for f in findings} == {"plan.no_stirrer", "plan.no_gas"}
    assert all(f["context"]["line"] == 1 for f in findings)
    assert "plan.no_stirrer" in err


def without_water() -> str:
    graph = bench()
    graph["nodes"] = [n for n in graph["nodes"] if n["id"] != "flask_water"]
    graph["links"] = [n for n in graph["links"] if n["source"] != "flask_water"]
    return json.dumps(graph)


def called(
    folder: Path, capsys: pytest.CaptureFixture[str], text: str, graph: str, *options: str
) -> tuple[int, str, str]:
    """Run the command in this process: exit code, and what it printed."""
    (folder / "graph.json").write_text(graph)
    (folder / "recipe.xdl").write_text(text)
    try:
        lab = str(folder / "graph.json")
        call_command(COMMAND.rpartition(".")[2], str(folder / "recipe.xdl"), "--lab", lab, *options)
        code = 0
    except CommandError as error:
        code = error.returncode
    out, err = capsys.readouterr()
    return code, out, err


def test_advice_is_a_graph_that_compiles_and_is_written_only_when_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    graph, target = without_water(), tmp_path / "better.json"
    code, out, _ = called(tmp_path, capsys, recipe(ADD), graph, "--json")
    assert (code, target.exists()) == (2, False)
    advice = json.loads(out)["advice"]
    assert [change["change"] for change in advice["changes"]] == ["add_flask"]
    options = ("--write-graph", str(target))
    code, out, _ = called(tmp_path, capsys, recipe(ADD), graph, *options)
    assert code == 2
    assert "1  Add flask flask_water of 100 mL for water at port" in out
    assert (tmp_path / "graph.json").read_text() == graph
    written = target.read_bytes()
    assert hashlib.sha256(written).hexdigest() == advice["graph_sha256"]
    assert json.loads(written) == advice["graph"]
    assert called(tmp_path, capsys, recipe(ADD), written.decode())[0] == 0
    assert called(tmp_path, capsys, recipe(ADD), graph, *options)[0] == 1
    assert target.read_bytes() == written


def test_without_advice_it_is_said_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = recipe('Transfer from_vessel="reactor" to_vessel="filter" volume="all"')
    graph = json.dumps(bench())
    code, out, _ = called(tmp_path, capsys, text, graph, "--json")
    assert code == 2
    assert [f["code"] for f in json.loads(out)["advice"]["findings"]] == ["plan.no_advice"]
    assert "plan.no_advice" in called(tmp_path, capsys, text, graph)[2]
    target = tmp_path / "x.json"
    assert called(tmp_path, capsys, text, graph, "--write-graph", str(target))[0] == 2
    assert not target.exists()


def other_port(action: dict[str, Any]) -> None:
    action["parameters"]["port"] = "3"


def no_volume(action: dict[str, Any]) -> None:
    del action["parameters"]["volume_ul"]


@pytest.mark.parametrize(
    ("name", "alter", "code"),
    [
        ("set_port", other_port, "interpret.no_path"),
        ("dispense", no_volume, "interpret.shape"),
    ],
)
def test_a_plan_of_which_one_action_is_wrong_is_not_shown(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    alter: Callable[[dict[str, Any]], None],
    code: str,
) -> None:
    def altered(*asked: Any) -> dict[str, Any]:  # noqa: ANN401 - arguments are passed on
        plan = compile_recipe(*asked)
        actions = (a for step in plan["steps"] for group in step["actions"] for a in group)
        alter(next(action for action in actions if action["action"] == name))
        return plan

    (tmp_path / "graph.json").write_text(json.dumps(bench()))
    (tmp_path / "recipe.xdl").write_text(recipe(ADD))
    files = (str(tmp_path / "recipe.xdl"), "--lab", str(tmp_path / "graph.json"))
    call_command("compile_protocol", *files, "--json")
    assert json.loads(capsys.readouterr().out)["ok"]
    monkeypatch.setattr("labweb.domain.recipes.compile_recipe_file.compile_recipe", altered)
    with pytest.raises(CommandError, match=r"plan\.not_proved") as caught:
        call_command("compile_protocol", *files, "--json")
    assert caught.value.returncode == 2
    answer = json.loads(capsys.readouterr().out)
    assert not answer["ok"]
    assert {"plan.not_proved", code} <= {finding["code"] for finding in answer["findings"]}


@pytest.mark.parametrize(
    ("text", "graph", "options", "code"),
    [
        ("<Synthesis", "", (), 2),
        (recipe(ADD), "{}", (), 1),
        (recipe(ADD), "", ("--bind", "water"), 1),
        (recipe(ADD), "", ("--holds", "reactor=water"), 1),
        (recipe(ADD), "", ("--holds", "reactor=water:much"), 1),
        (recipe(ADD), "", ("--holds", "nowhere=water:1 mL"), 2),
    ],
)
def test_what_cannot_be_read_is_told_without_a_traceback(
    tmp_path: Path, text: str, graph: str, options: tuple[str, ...], code: int
) -> None:
    found, _, err = run(tmp_path, text, *options, graph=graph)
    assert found == code
    assert err
    assert "Traceback" not in err


STATION = ROOT / "fixtures/labs/organic_synthesis"


def planned(tmp_path: Path, declared: str, *options: str) -> tuple[int, str, str]:
    (tmp_path / "declared.json").write_text(declared)
    text = (STATION / "protocols/benzhydryl_acetate.xdl").read_text("utf-8")
    graph = (STATION / "lab.json").read_text("utf-8")
    given = ("--declared", str(tmp_path / "declared.json"), *options)
    return run(tmp_path, text, "--json", *given, graph=graph)


def test_an_option_that_is_given_again_is_one_more(tmp_path: Path) -> None:
    bind = ("--bind", "reactor=nowhere", "--bind", "water=nothing")
    code, out, _ = run(tmp_path, recipe(ADD), "--json", *bind)
    told = " ".join(finding["message"] for finding in json.loads(out)["findings"])
    assert (code, "nowhere" in told, "nothing" in told) == (2, True, True)


def test_what_a_vessel_holds_is_given_once(tmp_path: Path) -> None:
    holds = ("--holds", "reactor=water:5 mL", "reactor=water:6 mL")
    code, out, err = run(tmp_path, recipe(ADD), *holds)
    assert (code, out, "given twice" in err) == (1, "", True)


def test_what_is_stated_beside_a_recipe_binds_it(tmp_path: Path) -> None:
    declared = (STATION / "protocols/benzhydryl_acetate.declared.json").read_text("utf-8")
    code, out, err = planned(tmp_path, declared)
    assert (code, err) == (0, "")
    assert json.loads(out)["plan"]["bindings"]["reagents"]["brine"] == "bottle_brine"


def test_what_is_bound_by_hand_wins_over_what_is_stated(tmp_path: Path) -> None:
    declared = (STATION / "protocols/benzhydryl_acetate.declared.json").read_text("utf-8")
    swapped = ("brine=bottle_ether", "diethyl ether=bottle_brine")
    code, out, _ = planned(tmp_path, declared, "--bind", *swapped)
    assert code == 0
    bound = json.loads(out)["plan"]["bindings"]["reagents"]
    assert bound["diethyl ether"] == "bottle_brine"
    assert bound["brine"] == "bottle_ether"


def test_what_reacts_with_water_is_not_led_over_brine_that_is_nowhere_known_to_quench_it(
    tmp_path: Path,
) -> None:
    declared = (STATION / "protocols/benzhydryl_acetate.declared.json").read_text("utf-8")
    code, out, _ = planned(tmp_path, declared, "--bind", "brine=bottle_water", "water=bottle_brine")
    assert code == 2
    found = [(one["code"], one["message"]) for one in json.loads(out)["findings"]]
    told = {code for code, text in found if "acetyl chloride must not meet brine" in text}
    assert told == {"plan.no_rinse", "plan.incompatible"}
    carried = [text for _, text in found if "is wet with brine, which goes with it" in text]
    assert carried, "brine that wets the lines goes with the water onto the acetyl chloride"


def test_two_reagents_in_one_flask_are_refused_with_what_it_says_it_holds(tmp_path: Path) -> None:
    declared = (STATION / "protocols/benzhydryl_acetate.declared.json").read_text("utf-8")
    code, out, _ = planned(tmp_path, declared, "--bind", "water=bottle_brine")
    assert code == 2
    (found,) = json.loads(out)["findings"]
    assert found["code"] == "plan.shared_flask"
    assert "'brine' and 'water' would come out of bottle_brine" in found["message"]
    assert found["context"]["holds"] == ["Sodium chloride, saturated in water"]


def test_a_file_that_states_nothing_that_is_read_is_exit_code_2(tmp_path: Path) -> None:
    code, out, err = planned(tmp_path, '{"schema": "labweb.other/1"}')
    assert code == 2
    assert json.loads(out)["findings"][0]["code"] == "xdl.not_declared"
    assert "labweb.other/1" in err
