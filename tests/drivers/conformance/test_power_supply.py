"""What every supply does, whichever maker's."""

from collections.abc import Iterator

import pytest

from drivers.load import read_status, read_statuses
from labweb.domain.errors import Effect, PreconditionError
from tests.drivers.conformance.cases import SUPPLIES, SUPPLY
from tests.drivers.conformance.placed_models import Bench, Case, Doing, do, running
from tests.fixtures.running import until

every = pytest.mark.parametrize("case", SUPPLIES, ids=lambda case: case.model)

EMF_V, OHM = 1.48, 0.4928
"""The load on the bench takes no current below its own voltage."""


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(SUPPLIES) as bench:
        yield bench


@every
def test_it_keeps_the_voltage_as_long_as_the_current_allows(bench: Bench, case: Case) -> None:
    with bench.connected(case) as supply:
        evidence = do(supply, SUPPLY).evidence
        assert evidence["voltage_v"] == pytest.approx(2.0, abs=0.02)
        assert evidence["current_ma"] == pytest.approx((2.0 - EMF_V) / OHM * 1000, abs=10)
        assert evidence.get("keeps", "voltage") == "voltage"
        assert read_status(supply, "voltage_setpoint_v") == pytest.approx(2.0)
        assert read_status(supply, "current_setpoint_ma") == pytest.approx(3000.0)
        assert not bench.is_over(case)


@every
def test_it_keeps_the_current_where_that_is_reached_first(bench: Bench, case: Case) -> None:
    with bench.connected(case) as supply:
        evidence = do(supply, ("supply", {"voltage_v": 5.0, "current_ma": 1500.0})).evidence
        assert evidence["current_ma"] == pytest.approx(1500.0, abs=10)
        assert evidence["voltage_v"] == pytest.approx(EMF_V + 1.5 * OHM, abs=0.02)
        assert evidence.get("keeps", "current") == "current"


@every
def test_no_current_flows_once_it_is_off(bench: Bench, case: Case) -> None:
    with bench.connected(case) as supply:
        do(supply, SUPPLY)
        evidence = do(supply, ("stop_supply", {})).evidence
        assert evidence["current_ma"] == 0
        assert not evidence.get("is_on", False)
        until(lambda: bench.is_over(case), 1)


@every
def test_a_stop_turns_the_output_off(bench: Bench, case: Case) -> None:
    with bench.connected(case, settle_s=20.0) as supply:
        before = len(bench.acts(case, "output"))
        doing = Doing(supply, SUPPLY)
        until(lambda: len(bench.acts(case, "output")) > before)
        supply.stop()
        error = doing.failure()
        assert (error.code, error.effect) == ("device.stopped", Effect.PARTIAL)
        assert error.context["current_ma"] == 0
        until(lambda: bench.is_over(case), 1)


@every
def test_a_trip_is_told_and_not_taken_for_success(bench: Bench, case: Case) -> None:
    if case.model in {"tdk_genesys", "manson_hcs"}:
        pytest.skip("this model has no command that tells a trip")
    with bench.connected(case, settle_s=0.4) as supply:
        before = len(bench.acts(case, "output"))
        doing = Doing(supply, SUPPLY)
        until(lambda: len(bench.acts(case, "output")) > before)
        bench.inflict(case, "alarm")
        error = doing.failure()
        assert error.effect is not Effect.NONE


@every
def test_every_status_is_a_number(bench: Bench, case: Case) -> None:
    with bench.connected(case) as supply:
        assert all(isinstance(value, float | int) for value in read_statuses(supply).values())


def test_a_voltage_between_two_steps_is_refused_and_not_rounded(bench: Bench) -> None:
    case = next(case for case in SUPPLIES if case.model == "manson_hcs")
    with bench.connected(case) as supply, pytest.raises(PreconditionError) as caught:
        do(supply, ("supply", {"voltage_v": 1.82, "current_ma": 1500.0}))
    assert caught.value.code == "device.resolution"
