"""Two pumps on one backbone: what one of them cannot reach, both do, their plungers together."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from deploy.embedded.layout import DEFAULT_LAB
from tests.system.stack import Stack, is_over, running

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]


@pytest.fixture(scope="module")
def stack() -> Iterator[Stack]:
    """Start the starter lab with a tube between port 7 of its two valves."""
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    lab = json.loads(DEFAULT_LAB.read_bytes())
    lab["connections"].append(
        {
            "key": "backbone",
            "source": {"resource": "valve_1", "port": "7"},
            "target": {"resource": "valve_2", "port": "7"},
            "medium": "liquid",
            "is_two_way": True,
            "dead_volume_ul": 100,
        }
    )
    (folder / "lab.json").write_text(json.dumps(lab))
    try:
        with running(folder / "data", lab=folder / "lab.json", speed=20.0) as made:
            yield made
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def volumes_nl(stack: Stack) -> dict[str, int]:
    rows = stack.client().get("resources")["resources"]
    return {row["key"]: row["volume_nl"] for row in rows if row["holds_liquid"]}


def test_a_transfer_over_two_pumps_reaches_the_bottle_and_the_record(stack: Stack) -> None:
    keys, before = stack.keys(), volumes_nl(stack)
    params = {"source": keys["acid"], "target": keys["dye"], "volume": "8 mL"}
    run = stack.client().start_step("transfer", params)
    seen = stack.client().wait_for_run(run["id"], is_over, 120)
    told = [(j["sentence"], j["state"], j["code"], j["message"]) for j in seen["jobs"] if j["code"]]
    assert seen["state"] == "complete", told
    after = volumes_nl(stack)
    assert before["acid"] - after["acid"] == 8_000_000
    assert after["dye"] - before["dye"] == 8_000_000
    assert after["pump_1"] == after["pump_2"] == 0
    assert stack.volumes_ul()["dye"] == pytest.approx(after["dye"] / 1000, abs=20.0)
    pairs = [job for job in seen["jobs"] if job["meets"] is not None]
    assert len(pairs) == 4
    for giver, receiver in zip(pairs[::2], pairs[1::2], strict=True):
        assert (giver["meets"], receiver["meets"]) == (receiver["index"], giver["index"])
        assert giver["started_at"] < receiver["ended_at"]
        assert receiver["started_at"] < giver["ended_at"]
