"""Each benchmark of the edge, tiny: it measures something, and says when a limit is broken."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

from benchmarks import steps
from benchmarks.figures import fsync_ms


@pytest.mark.timeout(300)
def test_every_figure_of_the_steps_is_measured(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(steps, "HOSTS_COUNT", 1)
    with tempfile.TemporaryDirectory(prefix="bm", dir="/tmp") as folder:
        figures = steps.run(Path(folder), 4, (6,), 2, with_peers=False)
    assert {one.name for one in figures} == {
        "peer: plain Celery, nothing durable",
        "one device, 4 steps",
        "of it, processor of its line",
        "two devices of a host, in turn",
        "two hosts, in turn",
        "20 steps on 2 devices",
        "dearest over cheapest of 4, 6 steps",
    }
    assert all(one.value > 0 for one in figures if not one.name.startswith("of it"))
    parallel = next(one for one in figures if one.name.startswith("20 steps"))
    assert parallel.value >= 10 * steps.PARALLEL_STEP_S
    assert "fsync" in capsys.readouterr().out


def test_an_fsync_takes_time(tmp_path: Path) -> None:
    assert fsync_ms(tmp_path, 5) > 0.0
