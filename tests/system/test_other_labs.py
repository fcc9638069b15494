"""Labs that nobody here drew: a published station, and labs generated from a seed."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from tests.corpus import GRAPHS, NO_GRAPHS, NO_XDL, XDL
from tests.labs import generated_lab
from tests.system.stack import Stack, is_over, running

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

STATION = GRAPHS / "comprehensive_protocol" / "comprehensive_station.json"


@pytest.fixture
def folder() -> Iterator[Path]:
    """Give a folder with a path short enough for sockets."""
    made = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    try:
        yield made
    finally:
        shutil.rmtree(made, ignore_errors=True)


def volumes_nl(stack: Stack) -> dict[str, int]:
    """Return what the record says each vessel holds."""
    rows = stack.client().get("resources")["resources"]
    return {row["key"]: row["volume_nl"] for row in rows if row["holds_liquid"]}


def transfer(stack: Stack, source: str, target: str, volume: str) -> None:
    """Run a transfer to its end and compare the record with what really moved."""
    keys = stack.keys()
    before = volumes_nl(stack)
    params = {"source": keys[source], "target": keys[target], "volume": volume}
    run = stack.client().start_step("transfer", params)
    seen = stack.client().wait_for_run(run["id"], is_over, 180)
    assert seen["state"] == "complete", [(j["sentence"], j["message"]) for j in seen["jobs"]]
    after = volumes_nl(stack)
    moved_nl = int(float(volume.split()[0]) * 1_000_000)
    assert before[source] - after[source] == moved_nl
    assert after[target] - before[target] == moved_nl
    really = stack.volumes_ul()
    assert really[target] == pytest.approx(after[target] / 1000, abs=20.0)
    lineage = stack.client().get(f"resources/{keys[target]}/lineage?direction=up&depth=3")
    assert keys[source] in {node["id"] for node in lineage["nodes"]}


@pytest.mark.skipif(not STATION.is_file(), reason=NO_GRAPHS)
def test_a_published_station_runs_a_transfer_and_refuses_one_without_a_route(folder: Path) -> None:
    with running(folder / "lab", lab=STATION) as stack:
        transfer(stack, "reagent_bottle_1", "main_reactor", "10 mL")
        keys = stack.keys()
        document = {
            "schema": "labweb.workflow/1",
            "name": "No way",
            "steps": [
                {
                    "id": "step",
                    "kind": "transfer",
                    "params": {
                        "source": keys["reagent_bottle_1"],
                        "target": keys["collection_bottle_1"],
                        "volume": "10 mL",
                    },
                    "position": {"x": 0, "y": 0},
                }
            ],
            "edges": [],
        }
        answer = stack.client().call("POST", "workflows/check", {"document": document})
        assert answer["plan"] is None
        finding = answer["findings"][0]
        assert finding["code"].startswith("plan.")
        rows = stack.client().get("resources")["resources"]
        name = next(row["name"] for row in rows if row["key"] == "collection_bottle_1")
        assert f"{name} can be reached from nothing" in finding["message"]


SEEDS = range(20) if os.environ.get("LABWEB_SOAK") else range(1)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_generated_lab_runs_a_transfer(folder: Path, seed: int) -> None:
    raw = generated_lab(seed)
    (folder / "lab.json").write_bytes(raw)
    with running(folder / "data", lab=folder / "lab.json") as stack:
        source, target = find_pair(stack, json.loads(raw))
        transfer(stack, source, target, "1 mL")


def find_pair(stack: Stack, lab: dict[str, object]) -> tuple[str, str]:
    """Return two vessels between which the lab can move 1 mL."""
    keys = stack.keys()
    names = {row["key"]: row for row in stack.client().get("resources")["resources"]}
    vessels = [key for key, row in names.items() if row["holds_liquid"] and not row["device"]]
    for source in vessels:
        for target in vessels:
            params = {"source": keys[source], "target": keys[target], "volume": "1 mL"}
            step = {"id": "s", "kind": "transfer", "params": params, "position": {"x": 0, "y": 0}}
            document = {
                "schema": "labweb.workflow/1",
                "name": "Pair",
                "steps": [step],
                "edges": [],
            }
            if source != target:
                found = stack.client().call("POST", "workflows/check", {"document": document})
                if found["plan"] is not None:
                    return source, target
    pytest.fail(f"no transfer of 1 mL is possible in {lab['name']}")


def in_turn(stack: Stack, *steps: tuple[str, Mapping[str, object]]) -> None:
    """Draw steps one after the other, names of resources for their ids, and run them to the end."""
    keys = stack.keys()
    drawn = [
        {
            "id": f"s{place}",
            "kind": kind,
            "params": {
                name: keys.get(value, value) if isinstance(value, str) else value
                for name, value in params.items()
            },
            "position": {"x": 0, "y": 100 * place},
        }
        for place, (kind, params) in enumerate(steps)
    ]
    edges = [
        {
            "id": f"e{place}",
            **{"source": f"s{place}", "source_port": "done"},
            **{"target": f"s{place + 1}", "target_port": "start"},
        }
        for place in range(len(steps) - 1)
    ]
    version = stack.client().draw({"name": "In turn", "steps": drawn, "edges": edges})
    run = stack.client().start_version(version)
    seen = stack.client().wait_for_run(run["id"], is_over, 240)
    assert seen["state"] == "complete", [(j["sentence"], j["message"]) for j in seen["jobs"]]


@pytest.mark.skipif(not STATION.is_file(), reason=NO_GRAPHS)
def test_a_published_station_moves_heats_stirs_and_evacuates(folder: Path) -> None:
    with running(folder / "lab", lab=STATION) as stack:
        in_turn(
            stack,
            *(
                ("transfer", {"source": source, "target": "main_reactor", "volume": volume})
                for source, volume in (("reagent_bottle_1", "10 mL"), ("reagent_bottle_2", "30 mL"))
            ),
            (
                "heat_chill",
                {
                    **{"vessel": "main_reactor", "temperature": "50 °C"},
                    **{"stir_speed": "400 rpm", "hold_for": "60 s"},
                },
            ),
            (
                "device_action",
                {
                    **{"device": "vacuum_pump_1", "action": "evacuate_to"},
                    "args": {"pressure_kpa": 20, "tolerance_kpa": 2},
                },
            ),
            ("device_action", {"device": "vacuum_pump_1", "action": "stop_pump"}),
            ("stir", {"vessel": "separator_1", "stir_speed": "200 rpm", "duration": "30 s"}),
            ("transfer", {"source": "reagent_bottle_5", "target": "separator_1", "volume": "5 mL"}),
        )
        really = stack.volumes_ul()
        held = {key: nl / 1000 for key, nl in volumes_nl(stack).items() if key in really}
        assert (held["main_reactor"], held["separator_1"]) == (40_000, 5_000)
        assert {key: really[key] for key in held} == pytest.approx(held, abs=20)
        verbs = {key: [one["verb"] for one in stack.actuations(key)] for key in
                 ("stirrer_1", "stirrer_2", "heater_1", "vacuum_pump_1")}  # fmt: skip
        assert all(verbs.values()), verbs


RIG = XDL / "graphs" / "mcrav" / "lidocaine_graph.json"


@pytest.mark.skipif(not RIG.is_file(), reason=NO_XDL)
def test_a_chemputer_moves_heats_and_stirs_on_its_own_pumps_and_valves(folder: Path) -> None:
    with running(folder / "lab", lab=RIG) as stack:
        in_turn(
            stack,
            ("transfer", {"source": "flask_water", "target": "filter1", "volume": "5 mL"}),
            ("start_stir", {"vessel": "filter1", "stir_speed": "300 rpm"}),
            ("heat_chill", {"vessel": "filter1", "temperature": "40 °C", "hold_for": "60 s"}),
            ("stop_stir", {"vessel": "filter1"}),
            ("transfer", {"source": "flask_hcl", "target": "flask_separator", "volume": "60 mL"}),
        )
        really = stack.volumes_ul()
        assert (really["filter1"], really["flask_water"]) == (5_000, 995_000)
        assert (really["flask_separator"], really["flask_hcl"]) == (60_000, 40_000)
        # Water is at port 2 of its valve and the filter at 3, as the graph has it.
        turns = [one["detail"]["to"] for one in stack.actuations("valve_filter")]
        assert turns == ["2", "3"]
