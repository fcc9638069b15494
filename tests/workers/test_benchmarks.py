"""Each benchmark of the edge, tiny: it measures something, and says when a limit is broken."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

from benchmarks import steps
from benchmarks.clicks import p95
from benchmarks.figures import Figure, fsync_ms, show


@pytest.mark.timeout(300)
def test_every_figure_of_the_steps_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    with tempfile.TemporaryDirectory(prefix="bm", dir="/tmp") as folder:
        figures = steps.run(Path(folder), 4, (6,), 2)
    assert {one.name for one in figures} == {
        "peer: plain Celery, nothing durable",
        "one device, 4 steps",
        "two devices of a host, in turn",
        "two hosts, in turn",
        "20 steps on 2 devices",
        "dearest over cheapest of 4, 6 steps",
    }
    assert all(one.value > 0 for one in figures)
    parallel = next(one for one in figures if one.name.startswith("20 steps"))
    assert parallel.value >= 10 * steps.PARALLEL_STEP_S
    assert "fsync" in capsys.readouterr().out


def test_a_figure_beyond_its_limit_fails_and_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    kept, beyond = Figure("a", 1.9, 2.0, "ms"), Figure("b", 2.1, 2.0, "ms")
    peer = Figure("peer", 99.0, None, "ms")
    assert show([kept, peer]) == 0
    assert "BEYOND" not in capsys.readouterr().out
    assert show([kept, beyond]) == 1
    assert capsys.readouterr().out.count("BEYOND") == 1


def test_the_ninety_fifth_of_a_hundred() -> None:
    assert p95([float(one) for one in range(1, 101)]) == 95.0
    assert p95([3.0]) == 3.0
    assert p95([float(one) for one in range(1, 21)]) == 19.0


def test_an_fsync_takes_time(tmp_path: Path) -> None:
    assert fsync_ms(tmp_path, 5) > 0.0
