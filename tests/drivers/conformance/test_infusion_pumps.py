"""What holds for every infusion pump, each against its own instrument over its own wire."""

from __future__ import annotations

import threading

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import read_status
from labweb.domain.errors import DeviceError, Effect, PreconditionError
from tests.drivers.conformance.conftest import Rig
from tests.drivers.conformance.instruments import of_role

every_pump = pytest.mark.parametrize(
    "rig", of_role("infusion_pump"), indirect=True, ids=lambda case: case.id
)


@every_pump
def test_what_a_stroke_reports_is_what_the_vessel_lost_and_got_back(rig: Rig) -> None:
    start_ul = rig.vessel_ul(0)
    drawn = rig.call("withdraw", volume_ul=400.0, rate_ul_s=rig.case.rate_ul_s)
    assert drawn.moved_ul == pytest.approx(400.0, rel=0.01)
    assert start_ul - rig.vessel_ul(0) == pytest.approx(drawn.moved_ul, abs=drawn.resolution_ul)
    assert read_status(rig.driver, "withdrawn_ul") == drawn.moved_ul
    pushed = rig.call("infuse", volume_ul=400.0, rate_ul_s=rig.case.rate_ul_s)
    assert rig.vessel_ul(0) == pytest.approx(start_ul, abs=2 * drawn.resolution_ul)
    assert read_status(rig.driver, "infused_ul") == pushed.moved_ul
    assert read_status(rig.driver, "is_running") is False


@every_pump
def test_a_stroke_that_does_not_fit_sends_no_byte(rig: Rig) -> None:
    rate_ul_s = rig.case.rate_ul_s
    for volume_ul, rate in ((10_001.0, rate_ul_s), (400.0, 9_999.0), (400.0, 0.000_001)):
        with pytest.raises(PreconditionError):
            rig.call("infuse", volume_ul=volume_ul, rate_ul_s=rate)
    assert rig.sent == []


@every_pump
def test_a_stop_in_mid_stroke_says_how_much_went(rig: Rig) -> None:
    start_ul = rig.vessel_ul(0)
    timer = threading.Timer(0.05, rig.driver.stop)
    rig.when_acting = timer.start
    with pytest.raises(DeviceStoppedError) as caught:
        rig.call("withdraw", volume_ul=2000.0, rate_ul_s=rig.case.rate_ul_s)
    timer.join()
    rig.driver.clear_stop()
    assert caught.value.effect is Effect.PARTIAL
    went_ul = start_ul - rig.vessel_ul(0)
    assert 0 < went_ul < 2000
    assert caught.value.context["moved_ul"] == pytest.approx(went_ul, abs=2.0)
    rig.call("infuse", volume_ul=went_ul, rate_ul_s=rig.case.rate_ul_s)


@every_pump
def test_a_drive_that_stalls_leaves_the_outcome_unknown(rig: Rig) -> None:
    rig.inflict("plunger_overload", fraction=0.5)
    with pytest.raises(DeviceError, match="stall") as caught:
        rig.call("withdraw", volume_ul=400.0, rate_ul_s=rig.case.rate_ul_s)
    assert caught.value.effect is Effect.UNKNOWN
