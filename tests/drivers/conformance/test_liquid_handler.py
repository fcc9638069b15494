"""What every liquid handler does: what it tells has moved, and nothing moves twice."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import read_statuses
from labweb.domain.errors import DeviceError, Effect, PreconditionError
from tests.drivers.conformance.analysers import LIQUID_HANDLERS, OVER
from tests.drivers.conformance.placed_models import (
    Action,
    Bench,
    Case,
    Doing,
    do,
    impatient,
    running,
)
from tests.fixtures.running import until

every = pytest.mark.parametrize("case", LIQUID_HANDLERS, ids=lambda case: case.model)
MOVE: Action = ("transfer_liquid", {**OVER, "volume_ul": 100.0, "rate_ul_s": 100.0})
SLOW: Action = ("transfer_liquid", {**OVER, "volume_ul": 100.0, "rate_ul_s": 2.0})
TIPS = iter([f"{row}{column}" for column in range(1, 13) for row in "ABCDEFGH"])
"""The rack on the bench is used up from test to test."""


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(LIQUID_HANDLERS) as bench:
        yield bench


def volumes(bench: Bench, case: Case) -> tuple[float, float]:
    """Tell what source and target hold."""
    return (
        bench.vessel_ul(f"{case.model}_flask"),
        bench.vessel_ul(f"{case.model}_{case.ports[1]}"),
    )


def moved(bench: Bench, case: Case, before: tuple[float, float]) -> tuple[float, float]:
    """Tell what source has lost and target has gained."""
    after = volumes(bench, case)
    return before[0] - after[0], after[1] - before[1]


@every
def test_what_is_moved_is_told(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        do(device, ("initialize", {}))
        do(device, ("pick_up_tip", {"slot": "1", "well": next(TIPS)}))
        before = volumes(bench, case)
        assert do(device, MOVE).moved_ul == 100.0
        assert moved(bench, case, before) == pytest.approx((100.0, 100.0), abs=0.1)
        do(device, ("drop_tip", {}))


@every
def test_what_is_drawn_is_in_the_tip_until_it_is_given(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        do(device, ("initialize", {}))
        do(device, ("pick_up_tip", {"slot": "1", "well": next(TIPS)}))
        before = volumes(bench, case)
        place = {"slot": "2", "well": "A1", "volume_ul": 150.0, "rate_ul_s": 100.0}
        do(device, ("aspirate", place))
        assert moved(bench, case, before) == pytest.approx((150.0, 0.0), abs=0.1)
        assert read_statuses(device)["tip_volume_ul"] == 150.0
        do(device, ("dispense", {**place, "slot": "3", "volume_ul": 60.0}))
        assert moved(bench, case, before) == pytest.approx((150.0, 60.0), abs=0.1)
        do(device, ("drop_tip", {}))
        assert read_statuses(device)["has_tip"] is False


@every
def test_an_answer_that_is_lost_once_is_asked_for_and_nothing_moves_twice(
    bench: Bench, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, case, 0.5)
    with bench.connected(case) as device:
        do(device, ("initialize", {}))
        do(device, ("pick_up_tip", {"slot": "1", "well": next(TIPS)}))
        before, starts = volumes(bench, case), len(bench.acts(case, "aspirate"))
        bench.inflict(case, "no_answer", executes=True)
        cured = threading.Timer(0.7, bench.cure, (case,))
        cured.start()
        assert do(device, MOVE).moved_ul == 100.0
        cured.join()
        assert len(bench.acts(case, "aspirate")) == starts + 1
        assert moved(bench, case, before) == pytest.approx((100.0, 100.0), abs=0.1)
        do(device, ("drop_tip", {}))


@every
def test_a_stop_in_the_middle_leaves_the_tip_unknown(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        do(device, ("initialize", {}))
        do(device, ("pick_up_tip", {"slot": "1", "well": next(TIPS)}))
        starts = len(bench.acts(case, "aspirate"))
        doing = Doing(device, SLOW)
        until(lambda: len(bench.acts(case, "aspirate")) == starts + 1, 3)
        device.stop()
        error = doing.failure()
        assert isinstance(error, DeviceStoppedError)
        assert error.effect is Effect.UNKNOWN
        assert bench.is_over(case, "aspirate")
        assert read_statuses(device)["has_tip"] is None
        device.clear_stop()
        with pytest.raises(PreconditionError, match="initialise"):
            do(device, MOVE)


@every
def test_power_that_is_lost_in_mid_stroke_is_in_doubt(
    bench: Bench, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, case)
    with bench.connected(case) as device:
        do(device, ("initialize", {}))
        do(device, ("pick_up_tip", {"slot": "1", "well": next(TIPS)}))
        starts = len(bench.acts(case, "aspirate"))
        doing = Doing(device, SLOW)
        until(lambda: len(bench.acts(case, "aspirate")) == starts + 1, 3)
        bench.inflict(case, "power_loss", for_s=1000.0)
        error = doing.failure()
        assert error.effect is Effect.UNKNOWN
        assert len(error.context["key"]) == 36
        assert len(bench.acts(case, "aspirate")) == starts + 1


@every
def test_a_motion_that_fails_is_in_doubt(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        do(device, ("initialize", {}))
        do(device, ("pick_up_tip", {"slot": "1", "well": next(TIPS)}))
        bench.inflict(case, "stall")
        with pytest.raises(DeviceError) as caught:
            do(device, MOVE)
        assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.UNKNOWN)
