"""What every heater-stirrer does, whichever maker's."""

from collections.abc import Iterator

import pytest

from drivers.load import read_status
from labweb.domain.errors import Effect, PreconditionError
from tests.drivers.conformance.cases import HEATER_STIRRERS, STIR, WARM
from tests.drivers.conformance.placed_models import Bench, Case, Doing, do, running
from tests.fixtures.running import until

every = pytest.mark.parametrize("case", HEATER_STIRRERS, ids=lambda case: case.model)


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(HEATER_STIRRERS) as bench:
        yield bench


@every
def test_it_heats_to_the_setpoint_and_stays_on(bench: Bench, case: Case) -> None:
    with bench.connected(case) as plate:
        evidence = do(plate, WARM).evidence
        assert abs(evidence["temperature_c"] - 60.0) <= 1.0
        assert evidence["temperature_setpoint_c"] == 60.0
        assert read_status(plate, "temperature_setpoint_c") == 60.0
        assert abs(read_status(plate, "plate_temperature_c") - 60.0) <= 1.5
        assert not bench.is_over(case, "heater")
        do(plate, ("stop_heating", {}))
        until(lambda: bench.is_over(case, "heater"), 1)


@every
def test_it_stirs_at_the_speed_and_stands_again(bench: Bench, case: Case) -> None:
    with bench.connected(case) as plate:
        do(plate, STIR)
        assert abs(read_status(plate, "speed_rpm") - 300.0) <= 20.0
        assert read_status(plate, "speed_setpoint_rpm") == 300.0
        do(plate, ("stop_stirring", {}))
        assert read_status(plate, "speed_rpm") <= 20.0
        until(lambda: bench.is_over(case, "motor"), 1)


@every
def test_it_holds_what_is_reached(bench: Bench, case: Case) -> None:
    with bench.connected(case) as plate:
        do(plate, WARM)
        do(plate, ("hold", {"duration_s": 0.2, "temperature_c": 60.0, "tolerance_c": 2.0}))
        assert not bench.is_over(case, "heater")


@every
def test_it_does_not_hold_what_is_not_reached(bench: Bench, case: Case) -> None:
    with bench.connected(case) as plate:
        before = len(bench.acts(case))
        with pytest.raises(PreconditionError) as caught:
            do(plate, ("hold", {"duration_s": 0.2, "temperature_c": 190.0, "tolerance_c": 1.0}))
        assert caught.value.effect is Effect.NONE
        assert len(bench.acts(case)) == before


@every
def test_a_stop_ends_heating_and_stirring_and_says_how_far_it_came(
    bench: Bench, case: Case
) -> None:
    with bench.connected(case, settle_s=20.0) as plate:
        do(plate, STIR)
        before = len(bench.acts(case, "heater"))
        doing = Doing(plate, WARM)
        until(lambda: len(bench.acts(case, "heater")) > before)
        plate.stop()
        error = doing.failure()
        assert error.code == "device.stopped"
        assert error.effect is Effect.PARTIAL
        assert "temperature_c" in error.context
        until(lambda: bench.is_over(case, "heater") and bench.is_over(case, "motor"), 1)


@every
def test_a_motor_that_is_stalled_does_not_stay_on(bench: Bench, case: Case) -> None:
    if case.model == "ika_rct_digital":
        pytest.skip("this simulated model has no stalled motor")
    with bench.connected(case, speed_limit_s=0.2) as plate:
        bench.inflict(case, "stall")
        error = Doing(plate, STIR).failure()
        assert error.code in {"device.not_reached", "device.rejected"}
        assert error.effect is not Effect.UNKNOWN
        until(lambda: bench.is_over(case, "motor"), 1)
