"""What every thermostat and temperature controller does, whichever maker's."""

from collections.abc import Iterator

import pytest

from drivers.load import read_status
from fixtures.instruments.models import MODELS
from labweb.domain.errors import Effect, PreconditionError
from tests.drivers.conformance.cases import CONTROLLERS, TEMPER, THERMOSTATS
from tests.drivers.conformance.placed_models import Bench, Case, Doing, do, running
from tests.fixtures.running import until

EVERY_ONE = [*THERMOSTATS, *CONTROLLERS]
every = pytest.mark.parametrize("case", EVERY_ONE, ids=lambda case: case.model)
bath = pytest.mark.parametrize("case", THERMOSTATS, ids=lambda case: case.model)


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(EVERY_ONE) as bench:
        yield bench


@every
def test_it_reaches_the_temperature_and_stays_on(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        evidence = do(device, TEMPER).evidence
        assert abs(evidence["temperature_c"] - 60.0) <= 1.0
        assert evidence.get("temperature_setpoint_c", 60.0) == 60.0
        assert abs(read_status(device, "temperature_c") - 60.0) <= 5.0


@bath
def test_it_cools_as_it_heats(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        do(device, ("reach_temperature", {"temperature_c": case.cold_c, "tolerance_c": 1.0}))
        assert read_status(device, "is_controlling") is True
        assert abs(read_status(device, "bath_temperature_c") - case.cold_c) <= 1.5
        do(device, ("stop_control", {}))
        assert read_status(device, "is_controlling") is False
        until(lambda: bench.is_over(case), 1)


@every
def test_it_holds_what_is_reached(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        do(device, TEMPER)
        report = do(
            device, ("hold", {"duration_s": 0.2, "temperature_c": 60.0, "tolerance_c": 2.0})
        )
        assert report.evidence["held_s"] >= 0.2


@every
def test_it_does_not_hold_what_is_not_reached(bench: Bench, case: Case) -> None:
    with bench.connected(case) as device:
        before = len(bench.acts(case))
        with pytest.raises(PreconditionError) as caught:
            do(device, ("hold", {"duration_s": 0.2, "temperature_c": 85.0, "tolerance_c": 1.0}))
        assert caught.value.effect is Effect.NONE
        assert len(bench.acts(case)) == before


@every
def test_a_stop_ends_the_control_and_says_how_far_it_came(bench: Bench, case: Case) -> None:
    with bench.connected(case, settle_s=20.0) as device:
        before = len(bench.acts(case, case.verb))
        doing = Doing(device, TEMPER)
        until(lambda: len(bench.acts(case, case.verb)) > before)
        device.stop()
        error = doing.failure()
        assert error.code == "device.stopped"
        assert error.effect is Effect.PARTIAL
        assert "temperature_c" in error.context
        if case in THERMOSTATS:
            until(lambda: bench.is_over(case), 1)


@pytest.mark.parametrize(
    "case",
    [case for case in EVERY_ONE if "sensor_break" in MODELS[case.model].FAULTS],
    ids=lambda case: case.model,
)
def test_a_broken_sensor_ends_the_action(bench: Bench, case: Case) -> None:
    with bench.connected(case, settle_s=20.0, **case.outer) as device:
        before = len(bench.acts(case, case.verb))
        doing = Doing(device, TEMPER)
        until(lambda: len(bench.acts(case, case.verb)) > before)
        bench.inflict(case, "sensor_break")
        error = doing.failure()
        assert error.code in {"device.alarm", "device.rejected", "device.frame"}
        assert error.effect is not Effect.NONE


@bath
def test_a_power_cut_that_nobody_saw_is_noticed(bench: Bench, case: Case) -> None:
    with bench.connected(case, settle_s=20.0, poll_s=0.4) as device:
        before = len(bench.acts(case, case.verb))
        doing = Doing(device, TEMPER)
        until(lambda: len(bench.acts(case, case.verb)) > before)
        bench.inflict(case, "power_loss", for_s=1.0)
        error = doing.failure()
        assert error.code in {"device.alarm", "device.rejected", "device.timeout"}
        assert error.effect is not Effect.NONE
