"""A folder of recipes beside their rigs is judged pair by pair, and what refuses is ranked."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.corpus import compiled, judge, on_lab, totals
from benchmarks.corpus_pairs import Pair, find_pairs
from benchmarks.corpus_volumes import compare, of_events
from labweb.domain.errors import LabError
from labweb.domain.recipes.recipe_preview import PreviewAsked, open_recipe, workflow_from
from tests.corpus import NO_XDL, XDL
from tests.domain.recipes.plans import recipe
from tests.domain.recipes.rigs import chemputer

ROOT = Path(__file__).parents[2]
STATION = ROOT / "fixtures/labs"
ONE_PUMP = ("flask_water:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:1 = reactor:0")
WASTE = "valve_1:3 > waste_1:0"
ADD = 'Add vessel="reactor" reagent="water" volume="10 mL"'
HARDWARE = '<Component id="reactor" type="reactor"/>'


def written(folder: Path, *links: str, steps: tuple[str, ...] = (ADD,)) -> Pair:
    """Lay a recipe and its rig into a folder."""
    graph = chemputer(*links)
    for node in graph["nodes"]:
        node["chemical"] = {"flask_water": "water"}.get(node["id"], "")
        if not node["id"].startswith("pump"):
            node["max_volume"] = 100
    (folder / "short_graph.json").write_text(json.dumps(graph))
    (folder / "short.xdl").write_text(recipe(*steps, hardware=HARDWARE, reagents=("water",)))
    (pair,) = find_pairs(folder)
    return pair


def printed(folder: Path, *options: str) -> list[dict[str, Any]]:
    command = [sys.executable, "-m", "benchmarks.corpus", str(folder), *options]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [json.loads(line) for line in told.splitlines()]


def test_a_recipe_on_a_rig_with_one_pump_starts_and_is_proved(tmp_path: Path) -> None:
    judged = judge(written(tmp_path, *ONE_PUMP, WASTE), is_started=True)
    assert judged.findings == []
    assert (judged.is_compiled, judged.is_proved, judged.is_started) == (True, True, True)
    assert judged.beyond_count == 0


def test_a_flask_whose_key_has_blanks_is_one_that_a_run_draws_from(tmp_path: Path) -> None:
    pair = written(tmp_path, *ONE_PUMP, WASTE)
    pair.rig.write_text(pair.rig.read_text().replace("flask_water", "flask_3 M acetic acid (aq)"))
    judged = judge(pair, is_started=True)
    assert (judged.is_started, judged.findings) == (True, [])


def test_what_compiles_and_does_not_start_says_at_which_step_and_why(tmp_path: Path) -> None:
    pair = written(tmp_path, *ONE_PUMP, WASTE)
    rig = json.loads(pair.rig.read_text())
    # A lab has no driver for a valve with two tubes at a port; a rig is planned with what it draws.
    (again,) = [link for link in rig["links"] if link["target"] == "waste_1"]
    rig["nodes"].append({"id": "waste_2", "class": "ChemputerWaste", "max_volume": 100})
    rig["links"].append({**again, "id": 99, "target": "waste_2"})
    pair.rig.write_text(json.dumps(rig))
    judged = judge(pair, is_started=True)
    assert (judged.is_proved, judged.is_started) == (True, False)
    assert {(one["at"], one["code"]) for one in judged.findings} == {("start", "plan.no_device")}
    assert judge(pair, is_started=False).is_started is None


def test_a_recipe_that_is_not_compiled_says_why_and_is_not_started(tmp_path: Path) -> None:
    pair = written(tmp_path, *ONE_PUMP, WASTE, steps=(ADD.replace("10 mL", "1 L"),))
    judged = judge(pair, is_started=True)
    assert (judged.is_compiled, judged.is_proved, judged.is_started) == (False, False, None)
    (found,) = [one for one in judged.findings if one["step"]]
    assert (found["at"], found["code"], found["step"]) == ("compile", "plan.overflow", "Add")
    ranked = {"at": "compile", "code": "plan.overflow", "step": "Add", "recipes": 2}
    assert ranked in totals([judged, judged])["refusals"]


def test_a_line_for_each_pair_and_the_totals_last_are_printed() -> None:
    line, last = printed(STATION, "--start")
    assert line == {
        "recipe": "organic_synthesis/protocols/benzhydryl_acetate.xdl",
        "rig": "organic_synthesis/lab.json",
        "compiled": True,
        "proved": True,
        "started": True,
        "ran": None,
        "findings": [],
    }
    counted = {"pairs": 1, "compiled": 1, "proved": 1, "started": 1}
    assert counted.items() <= last["totals"].items()


def test_a_folder_without_a_pair_is_refused(tmp_path: Path) -> None:
    (tmp_path / "alone.xdl").write_text(recipe(ADD, hardware=HARDWARE))
    command = [sys.executable, "-m", "benchmarks.corpus", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert "no recipe lies there beside a rig" in done.stderr


@pytest.mark.skipif(not XDL.exists(), reason=NO_XDL)
def test_the_pairs_of_the_published_corpus_are_found() -> None:
    found = {(p.recipe.stem, p.rig.name) for p in find_pairs(XDL)}
    assert ("Arbidol_step2", "graph.json") in found
    assert ("async", "bigrig.json") in found
    assert ("lidocaine", "graph_lidocaine__ON__orgsyn_v90p0251.json") in found
    assert len(find_pairs(XDL)) == 122


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.skipif(not XDL.exists(), reason=NO_XDL)
def test_of_each_published_pair_it_is_said_how_far_it_comes_or_why_not() -> None:
    *lines, last = printed(XDL, "--start")
    assert len(lines) == last["totals"]["pairs"]
    for line in lines:
        assert line["started"] is (None if not line["proved"] else not line["findings"])
        assert line["proved"] or line["findings"], line["recipe"]
        assert all(one["code"] and one["message"] for one in line["findings"])
    assert last["totals"]["proved"] >= 49
    started = {Path(line["recipe"]).stem for line in lines if line["started"]}
    assert started >= {f"Arbidol_step{step}" for step in (1, 2, 4, 5)}
    assert started >= {"precipitate", "stirring", "dry_in_reactor", "no_cleaning_solvents"}
    assert started >= {"lidocaine", "orgsyn_v80p0129", "orgsyn_v81p0262", "orgsyn_v83p0184a"}
    assert last["totals"]["started"] >= 32
    assert last["totals"]["refusals"]


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.skipif(not XDL.exists(), reason=NO_XDL)
def test_a_published_recipe_is_refused_on_its_page_as_it_is_when_it_is_saved() -> None:
    refused = 0
    for pair in find_pairs(XDL):
        try:
            recipe, plan = compiled(pair)
        except LabError:
            continue
        _, asked = on_lab(pair, plan, recipe)
        page = open_recipe(asked)
        document, findings = saved(asked)
        assert page["document"] == document, pair
        assert [one["message"] for one in page["findings"]] == findings, pair
        refused += document is None
    assert refused


def saved(asked: PreviewAsked) -> tuple[dict[str, Any] | None, list[str]]:
    """Return the workflow that is saved of a recipe, or why none is."""
    try:
        return workflow_from(asked)["document"], []
    except LabError as error:
        return None, [one.message for one in error.findings]


def test_what_went_over_a_syringe_is_a_reagent_of_its_flask_and_too_little_of_it_is_told() -> None:
    classes = {"flask": "ChemputerFlask", "pump": "ChemputerPump", "reactor": "ChemputerReactor"}
    nodes = {key: {"class": one, "chemical": ""} for key, one in classes.items()}
    nodes["flask"]["chemical"] = "water"
    moves = [("flask", "pump", 5_000_000), ("pump", "reactor", 4_000_000)]
    events = [
        {"subjects": [{"id": a, "role": "source"}, {"id": b, "role": "target"}], "amount_nl": nl}
        for a, b, nl in moves
    ]
    moved = of_events(events, {key: key for key in nodes}, nodes)
    assert moved == {("water", "reactor"): 4.0}
    does = {"kind": "transfer", "from": "flask", "to": "reactor", "lot": "water"}
    plan = {"steps": [{"of": {"operation": "Add"}, "does": {**does, "volume_ul": 5000.0}}]}
    (found,) = compare(plan, nodes, None, moved).differences
    assert found == {"reagent": "water", "vessel": "reactor", "ml": 4.0, "expected_ml": 5.0}


def test_a_solid_is_weighed_in_from_a_jar_that_a_person_has_filled(tmp_path: Path) -> None:
    steps = ('Confirm msg="Is it dry?"', 'AddSolid vessel="reactor" reagent="water" mass="2 g"')
    pair = written(tmp_path, *ONE_PUMP, WASTE, steps=steps)
    judged = judge(pair, is_started=True)
    assert (judged.is_started, judged.findings, judged.beyond_count) == (True, [], 0)


def test_the_only_waste_of_a_rig_is_taken_and_nothing_is_stirred_that_nothing_turns(
    tmp_path: Path,
) -> None:
    clean = 'CleanVessel vessel="rotavap" solvent="water" volume="5 mL" repeats="2"'
    links = ("flask_water:0 > valve_1:0", "pump_1:0 = valve_1:-1", "valve_1:1 = rotavap:evaporate")
    pair = written(tmp_path, *links, WASTE)
    hardware = '<Component id="rotavap" type="rotavap"/>'
    pair.recipe.write_text(recipe(clean, hardware=hardware, reagents=("water",)))
    judged = judge(pair, is_started=True)
    assert (judged.is_started, judged.findings) == (True, [])
