"""One recipe on three stations that are plumbed differently: only the graph changes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.proof.execute_plan import execute
from labweb.domain.proof.lot_amount_ranges import NOTHING, AmountRange
from labweb.domain.proof.plan_read import parse_plan
from labweb.domain.recipes.on_rig.equipment import Equipment, VesselSort
from tests.domain.recipes.plans import check_strokes, compiled

LAB = Path(__file__).parents[3] / "fixtures/labs/three_stations"
RECIPE = (LAB / "protocols/acetylation.xdl").read_bytes()
STATIONS: Mapping[str, dict[str, Any]] = {
    name: json.loads((LAB / f"{name}.json").read_text("utf-8")) for name in ("row", "wheel", "star")
}
UL, MG = 10**9, 10**9
"""Units of the verifier in a microlitre and in a milligram."""

Ledger = dict[str, dict[str, AmountRange]]


def ledger(plan: dict[str, Any], graph: dict[str, Any], act: int) -> Ledger:
    """Let the verifier carry out the steps of the first acts, and return what is where.

    Vessels go by their name in the recipe; all wastes are one.
    """
    rig = read_rig(json.dumps(graph).encode())
    head = {"recipe": {"id": "recipe", "sha256": "0" * 64}, "graph_sha256": "0" * 64}
    steps = [step for step in plan["steps"] if step["of"]["act"] <= act]
    part = plan | head | {"steps": steps, "totals": {}}
    state = execute(rig, parse_plan(json.dumps(part).encode()))
    names = {key: name for name, key in plan["bindings"]["vessels"].items()}
    wastes = {k for k, sort in Equipment(rig).vessels.items() if sort is VesselSort.WASTE}
    found: Ledger = {}
    for key, contents in state.contents.items():
        name = "waste" if key in wastes else names.get(key)
        there = found.setdefault(name, {}) if name else {}
        for lot, amount in (contents.liquids | contents.solids).items():
            if amount.most:
                there[lot] = there.get(lot, NOTHING) + amount
    return {name: held for name, held in found.items() if held}


def test_after_each_step_of_the_recipe_each_vessel_holds_the_same_on_all_stations() -> None:
    plans = {name: compiled(RECIPE, graph) for name, graph in STATIONS.items()}
    acts = {step["of"]["act"] for step in plans["row"]["steps"]}
    assert len(acts) > 5
    for act in sorted(acts):
        row, wheel, star = (ledger(plans[name], STATIONS[name], act) for name in STATIONS)
        assert row == wheel == star, act


def test_the_ledger_is_what_the_recipe_asks_for() -> None:
    plan = compiled(RECIPE, STATIONS["row"])
    before_washing = ledger(plan, STATIONS["row"], 5)
    assert before_washing == {
        "reactor": {
            "4-nitrobenzyl alcohol": AmountRange.exactly(3060 * MG),
            "dichloromethane": AmountRange.exactly(30_000 * UL),
            "triethylamine": AmountRange.exactly(3400 * UL),
            "acetyl chloride": AmountRange.exactly(1600 * UL),
        }
    }
    washed = ledger(plan, STATIONS["row"], 10**6)
    assert washed.keys() == {"product", "waste"}
    assert washed["product"]["water"] == AmountRange(0, 40_000 * UL)
    assert washed["product"]["4-nitrobenzyl alcohol"] == AmountRange(0, 3060 * MG)


def test_the_stations_do_it_with_other_devices() -> None:
    used = [
        {
            action["device"]
            for step in plan["steps"]
            for group in step["actions"]
            for action in group
        }
        for plan in (compiled(RECIPE, graph) for graph in STATIONS.values())
    ]
    for one, other in combinations(used, 2):
        assert not {key for key in one & other if key.startswith(("pump", "valve"))} - {"pump"}
    strokes = [check_strokes(compiled(RECIPE, graph), graph) for graph in STATIONS.values()]
    assert all(strokes)


def test_a_station_without_a_spare_flask_is_told_apart() -> None:
    graph = STATIONS["row"]
    fewer = {
        "nodes": [n for n in graph["nodes"] if n["id"] != "flask_spare"],
        "links": [n for n in graph["links"] if "flask_spare" not in (n["source"], n["target"])],
    }
    plan = compiled(RECIPE, fewer)
    other = ledger(plan, fewer, 10**6)
    assert other == ledger(compiled(RECIPE, graph), graph, 10**6)
