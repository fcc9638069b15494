"""Each benchmark runs, counts what it should, and fails beyond a limit. None is timed here."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import plans
from benchmarks.figures import Figure, p95_ms, report
from tests.corpus import GRAPHS

ROOT = Path(__file__).parents[2]
SIZES = {"transfer": 10, "tree": 1_000, "import": 500, "lineage": 500, "telemetry": 3}
"""Small: enough to see that it works."""

TIMES = ("ms", "s", "%")
"""Units of what depends on the machine, and on what else it does."""


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", SIZES)
def test_a_small_benchmark_keeps_its_counts(name: str) -> None:
    graph = GRAPHS / "large/prcxi_9320.json"
    given = ["--graph", str(graph)] if graph.exists() else []
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", name, "--size", str(SIZES[name]), *given],
        cwd=ROOT,
        env={k: v for k, v in os.environ.items() if not k.startswith("DJANGO")},
        capture_output=True,
        text=True,
        check=False,
    )
    lines = done.stdout.splitlines()
    # Broken off, it would end with 1 as well; to its end, it says the load last.
    assert done.returncode in {0, 1}, done.stderr
    assert lines[-1].startswith("  load of the machine"), done.stderr
    assert lines[0].startswith(f"{name} ")
    assert sum(sign in line for line in lines for sign in "≤≥") > 1, done.stdout
    broken = [line for line in lines if "BROKEN" in line]
    assert all(line.removesuffix("BROKEN").split()[-1] in TIMES for line in broken), done.stdout


def test_a_broken_limit_is_the_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    kept = Figure(name="kept", value=10, unit="ms", limit=10)
    low = Figure(name="too low", value=24.9, unit="%", limit=25, is_floor=True)
    told = Figure(name="told only", value=1e9, unit="s")
    assert report("one", [kept, told]) == 0
    assert "BROKEN" not in capsys.readouterr().out
    assert report("two", [kept, low]) == 1
    assert "24.90 %     ≥ 25 %   BROKEN" in capsys.readouterr().out


def test_p95_is_what_95_of_a_hundred_do_not_exceed() -> None:
    assert p95_ms([n / 1000 for n in range(1, 101)]) == 95
    assert p95_ms([0.007]) == 7


def test_plans_are_made_and_proved_beside_bare_paths() -> None:
    found = {one.name: one.value for one in plans.figures()}
    assert found["50 transfers: jobs"] == 4 * plans.TRANSFERS_COUNT + 1
    assert found["50 transfers: planned and proved"] > found["50 transfers: bare shortest paths"]
    assert any(name.startswith("synthesis of") for name in found)
