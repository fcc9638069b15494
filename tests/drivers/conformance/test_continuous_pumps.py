"""What holds for every continuous pump, each against its own instrument over its own wire."""

from __future__ import annotations

import threading
import time

import pytest

from drivers.base import DeviceStoppedError
from drivers.connectors._flow import deliver
from drivers.load import read_status
from labweb.domain.errors import Effect, PreconditionError, RejectedError
from tests.drivers.conformance.conftest import Rig
from tests.drivers.conformance.instruments import of_role

every_pump = pytest.mark.parametrize(
    "rig", of_role("continuous_pump"), indirect=True, ids=lambda case: case.id
)


@every_pump
def test_a_delivery_reports_what_went_from_inlet_to_outlet(rig: Rig) -> None:
    before_ul = (rig.vessel_ul(0), rig.vessel_ul(1))
    report = rig.call("deliver", volume_ul=200.0, rate_ul_s=500.0)
    assert read_status(rig.driver, "is_running") is False
    lost_ul, got_ul = before_ul[0] - rig.vessel_ul(0), rig.vessel_ul(1) - before_ul[1]
    assert lost_ul == pytest.approx(got_ul, abs=0.01)
    assert report.moved_ul == pytest.approx(got_ul, abs=30.0)


@every_pump
def test_a_flow_goes_on_until_it_is_stopped(rig: Rig) -> None:
    rig.call("start_flow", rate_ul_s=500.0)
    assert read_status(rig.driver, "is_running") is True
    assert read_status(rig.driver, "rate_setpoint_ul_s") == pytest.approx(500.0, rel=0.01)
    before_ul = rig.vessel_ul(1)
    time.sleep(0.3)
    assert rig.vessel_ul(1) > before_ul
    rig.call("stop_flow")
    assert read_status(rig.driver, "is_running") is False
    stood_ul = rig.vessel_ul(1)
    time.sleep(0.2)
    assert rig.vessel_ul(1) == stood_ul


@every_pump
def test_a_flow_may_be_started_twice_and_takes_the_second_rate(rig: Rig) -> None:
    rig.call("start_flow", rate_ul_s=200.0)
    rig.call("start_flow", rate_ul_s=500.0)
    assert read_status(rig.driver, "is_running") is True
    assert read_status(rig.driver, "rate_setpoint_ul_s") == pytest.approx(500.0, rel=0.01)
    rig.call("stop_flow")
    rig.call("stop_flow")


@every_pump
def test_a_rate_or_volume_out_of_range_sends_no_byte(rig: Rig) -> None:
    for name, arguments in (
        ("start_flow", {"rate_ul_s": 9_000.0}),
        ("start_flow", {"rate_ul_s": 0.001}),
        ("deliver", {"volume_ul": 1.0, "rate_ul_s": 500.0}),
        ("deliver", {"volume_ul": 9_000_000.0, "rate_ul_s": 500.0}),
    ):
        with pytest.raises(PreconditionError):
            rig.call(name, **arguments)
    assert rig.sent == []


@every_pump
def test_a_pump_that_runs_takes_no_delivery(rig: Rig) -> None:
    rig.call("start_flow", rate_ul_s=500.0)
    with pytest.raises(RejectedError) as caught:
        rig.call("deliver", volume_ul=200.0, rate_ul_s=500.0)
    assert caught.value.effect is Effect.NONE
    rig.call("stop_flow")


@every_pump
def test_a_pump_that_a_stop_stood_still_was_stopped_and_did_not_fail(rig: Rig) -> None:
    def stopped_while_it_is_asked() -> bool:
        rig.driver.stop()
        return bool(read_status(rig.driver, "is_running"))

    with pytest.raises(DeviceStoppedError) as caught:
        deliver(
            rig.driver,
            volume_ul=2000.0,
            rate_ul_s=500.0,
            begin=lambda: rig.call("start_flow", rate_ul_s=500.0),
            end=lambda: rig.call("stop_flow"),
            is_running=stopped_while_it_is_asked,
        )
    assert caught.value.effect is Effect.PARTIAL


@every_pump
def test_a_stop_in_mid_delivery_stops_the_pump_and_says_how_much_went(rig: Rig) -> None:
    before_ul = rig.vessel_ul(1)
    timer = threading.Timer(1.0, rig.driver.stop)
    rig.when_acting = timer.start
    with pytest.raises(DeviceStoppedError) as caught:
        rig.call("deliver", volume_ul=2000.0, rate_ul_s=200.0)
    timer.join()
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["moved_ul"] == pytest.approx(rig.vessel_ul(1) - before_ul, abs=40.0)
    stood_ul = rig.vessel_ul(1)
    time.sleep(0.2)
    assert rig.vessel_ul(1) == stood_ul
