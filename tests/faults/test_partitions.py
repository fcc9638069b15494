"""Three hosts and a server, cut from each other for good: what both know is the same after.

`make test` plays a few schedules, `make soak` 500 with the figures of independence and
detection; `python -m tests.faults.partitions --resume` goes on where a soak stopped.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.faults.netns import why_not
from tests.faults.partitions.__main__ import report
from tests.faults.partitions.lab import digest
from tests.workers.bench import ROOT

IS_SOAK = bool(os.environ.get("LABWEB_SOAK"))
SEEDS_COUNT = 500 if IS_SOAK else 3
FIRST = int(os.environ.get("LABWEB_SEED", "0")) * SEEDS_COUNT if IS_SOAK else 0


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Play in a process of its own, because it leaves this machine's network for another."""
    reason = why_not()
    if reason is not None:
        pytest.skip(f"hard partitions need network namespaces: {reason}")
    folder = ROOT / "docs" / "figures" if IS_SOAK else tmp_path_factory.mktemp("partitions")
    folder.mkdir(exist_ok=True, parents=True)
    record: Path = folder / "partitions.jsonl"
    command = [sys.executable, "-m", "tests.faults.partitions", "--record", str(record)]
    command += ["--seeds", f"{FIRST}..{FIRST + SEEDS_COUNT - 1}"]
    command += ["--measure-s", "20", "--detect"] if IS_SOAK else ["--measure-s", "0"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert record.exists(), done.stdout + done.stderr
    found = [json.loads(line) for line in record.read_text().splitlines()]
    assert len([one for one in found if one["seed"] >= 0]) == SEEDS_COUNT, done.stderr
    return found


@pytest.mark.slow
@pytest.mark.timeout(0 if IS_SOAK else 400)
def test_after_every_partition_host_and_server_know_the_same(figures: list[dict[str, Any]]) -> None:
    played = [one for one in figures if one["seed"] >= 0]
    assert [text for one in played for text in one["violations"]] == []
    assert all(one["pulls"] >= 1 and one["actions"] >= 1 for one in played)
    assert max(one["most_actuations"] for one in played) == 1


@pytest.mark.slow
@pytest.mark.skipif(not IS_SOAK, reason="figures over time: in make soak")
def test_hosts_go_on_at_their_rate_while_one_is_away_and_it_is_missed_in_time(
    figures: list[dict[str, Any]],
) -> None:
    measured = next(one for one in figures if one["seed"] == -1)
    lines, is_kept = report(measured)
    assert is_kept, lines


@pytest.mark.parametrize(
    ("change", "is_kept"),
    [
        ({}, True),
        ({"kept_ratio": 0.949}, False),
        ({"detection_s": 35.1}, False),
        ({"resync_s": 60.0}, False),
    ],
)
def test_a_figure_beyond_its_limit_fails_the_measurement(
    change: dict[str, float], *, is_kept: bool
) -> None:
    good = {"kept_ratio": 0.95, "rate": 14.0, "detection_s": 35.0, "resync_s": 59.9}
    lines, found = report(good | change)
    assert found is is_kept
    assert [line.partition(":")[0] for line in lines] == ["independence", "detection", "resync"]


def test_a_digest_tells_another_amount_and_not_an_empty_lot() -> None:
    one = digest({"a": {"lot": 5}, "b": {}})
    assert one == digest({"b": {"lot": 0}, "a": {"lot": 5}})
    assert one != digest({"a": {"lot": 4}, "b": {"lot": 1}})
