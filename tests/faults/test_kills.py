"""Kill -9 in a loop over the processes of a host: one actuation at most, and every doubt is said.

`make test` plays 50 kills, `make soak` 10 000, each seed's figures on a line of
docs/figures/kills.jsonl. `python -m tests.faults.kills --resume` goes on where a soak stopped.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.faults.kills.__main__ import KILLS_OF_A_SEED, done_before, main, soak, summary
from tests.workers.bench import ROOT

IS_SOAK = bool(os.environ.get("LABWEB_SOAK"))
SEEDS_COUNT = 200 if IS_SOAK else 1
FIRST = int(os.environ.get("LABWEB_SEED", "0")) * SEEDS_COUNT if IS_SOAK else 0


@pytest.mark.slow
@pytest.mark.timeout(0 if IS_SOAK else 300)
def test_no_kill_makes_a_device_act_twice_or_hides_a_doubt(tmp_path: Path) -> None:
    record = ROOT / "docs" / "figures" / "kills.jsonl" if IS_SOAK else tmp_path / "kills.jsonl"
    record.parent.mkdir(exist_ok=True, parents=True)
    seeds = range(FIRST, FIRST + SEEDS_COUNT)
    results = soak(seeds, KILLS_OF_A_SEED, record, resume=False)
    sys.stdout.write(summary(results) + "\n")
    assert [text for one in results for text in one["violations"]] == []
    assert sum(one["kills"] for one in results) >= KILLS_OF_A_SEED * SEEDS_COUNT
    assert sum(one["complete"] for one in results) >= 3 * SEEDS_COUNT
    assert max(one["most_actuations"] for one in results) == 1


def test_a_soak_that_was_interrupted_goes_on_with_the_next_seed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = tmp_path / "kills.jsonl"
    counts = {"kills": 50, "actions": 9, "complete": 6, "in_doubt": 3, "in_doubt_had_acted": 2}
    known = {"events": 40, "most_actuations": 1, "seconds": 5.0, "violations": [], **counts}
    lines = [json.dumps({"seed": seed, **known}) for seed in range(4)]
    record.write_text("\n".join(lines) + '\n{"seed": 4, "kil')
    assert sorted(done_before(record)) == [0, 1, 2, 3]
    assert main(["--seeds", "0..3", "--record", str(record), "--resume"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("4 seeds, 200 kills, 36 actions")
    assert "0.10 s a kill: 10000 in 17 min (limit 60)" in said
    assert record.read_text().splitlines() == lines  # and the line that was cut off is gone


def test_a_violation_in_the_record_fails_the_soak(tmp_path: Path) -> None:
    record = tmp_path / "kills.jsonl"
    counts = {"kills": 50, "actions": 9, "complete": 6, "in_doubt": 3, "in_doubt_had_acted": 2}
    bad = {
        "events": 40,
        "most_actuations": 2,
        "seconds": 5.0,
        "violations": ["acted 2 times"],
        **counts,
    }
    record.write_text(json.dumps({"seed": 7, **bad}) + "\n")
    command = [sys.executable, "-m", "tests.faults.kills", "--seeds", "7", "--resume"]
    done = subprocess.run(
        [*command, "--record", str(record)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "seed 7: acted 2 times" in done.stdout
