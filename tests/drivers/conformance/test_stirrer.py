"""What every overhead stirrer does, whichever maker's."""

from collections.abc import Iterator

import pytest

from drivers.load import read_status
from labweb.domain.errors import Effect
from tests.drivers.conformance.cases import STIR, STIRRERS
from tests.drivers.conformance.placed_models import Bench, Case, Doing, do, running
from tests.fixtures.running import until

every = pytest.mark.parametrize("case", STIRRERS, ids=lambda case: case.model)


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(STIRRERS) as bench:
        yield bench


@every
def test_it_stirs_at_the_speed_and_stands_again(bench: Bench, case: Case) -> None:
    with bench.connected(case) as stirrer:
        evidence = do(stirrer, STIR).evidence
        assert abs(evidence["speed_rpm"] - 300.0) <= 20.0
        assert evidence["torque_ncm"] > 0
        assert read_status(stirrer, "speed_setpoint_rpm") == 300.0
        do(stirrer, ("stop_stirring", {}))
        assert read_status(stirrer, "speed_rpm") <= 20.0
        until(lambda: bench.is_over(case), 1)


@every
def test_another_speed_is_taken_while_it_turns(bench: Bench, case: Case) -> None:
    with bench.connected(case) as stirrer:
        do(stirrer, STIR)
        do(stirrer, ("stir", {"speed_rpm": 500.0}))
        assert abs(read_status(stirrer, "speed_rpm") - 500.0) <= 20.0


@every
def test_a_stalled_motor_is_turned_off(bench: Bench, case: Case) -> None:
    with bench.connected(case, speed_limit_s=0.2) as stirrer:
        bench.inflict(case, "stall")
        error = Doing(stirrer, STIR).failure()
        assert error.code in {"device.not_reached", "device.alarm"}
        assert error.effect is Effect.PARTIAL
        until(lambda: bench.is_over(case), 1)


@every
def test_a_stop_turns_it_off_and_refuses_until_it_is_cleared(bench: Bench, case: Case) -> None:
    with bench.connected(case) as stirrer:
        do(stirrer, STIR)
        stirrer.stop()
        until(lambda: bench.is_over(case), 1)
        error = Doing(stirrer, STIR).failure()
        assert (error.code, error.effect) == ("device.stopped", Effect.NONE)
        do(stirrer, ("stop_stirring", {}))
        stirrer.clear_stop()
        do(stirrer, STIR)
