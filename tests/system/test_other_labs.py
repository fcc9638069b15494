"""Labs that nobody here drew: a published station, and labs generated from a seed."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.corpus import GRAPHS, NO_GRAPHS
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
