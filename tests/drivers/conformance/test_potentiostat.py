"""What every potentiostat does: its cell is off but while it measures."""

from __future__ import annotations

import csv
from collections.abc import Iterator

import pytest

from drivers.base import DeviceStoppedError, Report
from drivers.load import read_statuses
from labweb.domain.errors import Effect
from tests.drivers.conformance.analysers import POTENTIOSTATS, SWEEP
from tests.drivers.conformance.placed_models import Bench, Case, Doing, do, running
from tests.fixtures.running import until

every = pytest.mark.parametrize("case", POTENTIOSTATS, ids=lambda case: case.model)
SLOW_SWEEP = {**SWEEP, "rate_v_s": 0.002}
"""Eight seconds of the bench's clock: what comes from outside comes before its end."""

FORMAL_V = 0.2
"""Of the couple on the bench, of which 0.1 % are oxidised."""


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(POTENTIOSTATS) as bench:
        yield bench


def rows(report: Report) -> list[dict[str, float]]:
    """Read the one table that a measurement hands over."""
    (file,) = report.files
    assert (file.format, file.media_type) == ("csv", "text/csv")
    lines = [line for line in file.data.decode().splitlines() if not line.startswith("#")]
    return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(lines)]


@every
def test_an_open_cell_is_read_and_never_turned_on(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        before = len(bench.acts(case, case.verb))
        act = ("measure_open_circuit", {"duration_s": 10.0, "interval_s": 1.0})
        points = rows(do(device, act))
        assert len(points) == 10
        assert points[-1]["time (s)"] == pytest.approx(10.0, abs=0.2)
        # Nernst: 59 mV a decade below the formal potential, at 1 oxidised of 1000.
        assert points[-1]["potential (V)"] == pytest.approx(FORMAL_V - 3 * 0.0592, abs=0.01)
        assert len(bench.acts(case, case.verb)) == before


@every
def test_a_cycle_has_its_two_peaks_about_the_formal_potential(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        way = {"first_v": -0.2, "vertex_1_v": 0.6, "vertex_2_v": -0.2}
        act = ("sweep_cyclic", {**way, "step_v": 0.01, "rate_v_s": 0.1, "cycles_count": 1})
        report = do(device, act)
        points = rows(report)
        anodic = max(points, key=lambda row: row["current (A)"])
        cathodic = min(points, key=lambda row: row["current (A)"])
        middle_v = (anodic["potential (V)"] + cathodic["potential (V)"]) / 2
        assert middle_v == pytest.approx(FORMAL_V, abs=0.02)
        split_v = anodic["potential (V)"] - cathodic["potential (V)"]
        assert 0.05 < split_v < 0.1, "59 mV where the couple is fast"
        assert report.evidence["max_current_ma"] == pytest.approx(anodic["current (A)"] * 1e3)
        assert report.evidence["points_count"] == len(points)
        until(lambda: bench.is_over(case), 2)


@every
def test_a_held_potential_lets_the_current_decay(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        act = ("hold_potential", {"potential_v": 0.5, "duration_s": 20.0, "interval_s": 0.5})
        points = rows(do(device, act))
        early, late = points[1]["current (A)"], points[-1]["current (A)"]
        # Cottrell: with the root of time.
        wanted = (points[1]["time (s)"] / points[-1]["time (s)"]) ** 0.5
        assert late / early == pytest.approx(wanted, rel=0.2)
        assert all(row["potential (V)"] == pytest.approx(0.5, abs=0.001) for row in points)
        until(lambda: bench.is_over(case), 2)


@every
def test_a_stop_turns_the_cell_off(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        before = len(bench.acts(case, case.verb))
        doing = Doing(device, ("sweep_linear", SLOW_SWEEP))
        until(lambda: len(bench.acts(case, case.verb)) == before + 1, 3)
        until(lambda: read_statuses(device)["progress_ratio"] > 0, 3)
        device.stop()
        error = doing.failure()
        assert isinstance(error, DeviceStoppedError)
        assert error.effect is Effect.PARTIAL
        assert error.context["points_count"] > 0
        assert bench.is_over(case)


@every
def test_stopping_what_does_not_run_is_harmless(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        do(device, ("stop_measuring", {}))
        do(device, ("stop_measuring", {}))
        assert read_statuses(device)["is_measuring"] is False


@every
def test_what_goes_wrong_in_the_cell_ends_with_the_cell_off(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        before = len(bench.acts(case, case.verb))
        doing = Doing(device, ("sweep_linear", SLOW_SWEEP))
        until(lambda: len(bench.acts(case, case.verb)) == before + 1, 3)
        bench.inflict(case, "alarm")
        error = doing.failure()
        assert (error.code, error.effect) == ("device.alarm", Effect.PARTIAL)
        assert bench.is_over(case)
