"""What holds for every syringe pump, each against its own instrument over its own wire."""

from __future__ import annotations

import threading

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import read_status
from labweb.domain.errors import DeviceError, Effect, PreconditionError
from tests.drivers.conformance.conftest import Rig
from tests.drivers.conformance.instruments import of_role

PUMPS = of_role("pump")
every_pump = pytest.mark.parametrize("rig", PUMPS, indirect=True, ids=lambda case: case.id)


@every_pump
def test_a_zero_that_was_found_is_told(rig: Rig) -> None:
    assert read_status(rig.driver, "is_initialized") is True
    assert read_status(rig.driver, "volume_ul") == 0.0


@every_pump
def test_what_a_stroke_reports_is_what_the_vessel_lost(rig: Rig) -> None:
    before_ul = rig.vessel_ul(0)
    report = rig.call("aspirate", volume_ul=400.0, rate_ul_s=rig.case.rate_ul_s)
    assert report.moved_ul == pytest.approx(400.0, abs=report.resolution_ul)
    assert before_ul - rig.vessel_ul(0) == pytest.approx(report.moved_ul, abs=0.01)
    assert read_status(rig.driver, "volume_ul") == pytest.approx(report.moved_ul, abs=0.01)


@every_pump
def test_what_was_drawn_in_goes_out_at_the_port_that_is_selected(rig: Rig) -> None:
    last = len(rig.case.ports) - 1
    rig.call("aspirate", volume_ul=400.0, rate_ul_s=rig.case.rate_ul_s)
    if rig.case.last_port:
        rig.call("select_port", port_index=2)
    before_ul = rig.vessel_ul(last)
    report = rig.call("dispense", volume_ul=150.0, rate_ul_s=rig.case.rate_ul_s)
    assert rig.vessel_ul(last) - before_ul == pytest.approx(report.moved_ul, abs=0.01)
    assert read_status(rig.driver, "volume_ul") == pytest.approx(250.0, abs=1.0)


@every_pump
def test_initialising_pushes_out_what_the_syringe_held_and_says_so(rig: Rig) -> None:
    rig.call("aspirate", volume_ul=300.0, rate_ul_s=rig.case.rate_ul_s)
    report = rig.call("initialize")
    assert report.moved_ul == pytest.approx(300.0, abs=1.0)
    assert read_status(rig.driver, "volume_ul") == 0.0


@every_pump
def test_a_stroke_that_does_not_fit_sends_no_byte(rig: Rig) -> None:
    rate_ul_s = rig.case.rate_ul_s
    for volume_ul, rate in ((1001.0, rate_ul_s), (0.001, rate_ul_s), (400.0, 99_999.0)):
        with pytest.raises(PreconditionError):
            rig.call("aspirate", volume_ul=volume_ul, rate_ul_s=rate)
    assert rig.sent == []


@every_pump
def test_a_stroke_beyond_the_end_of_travel_moves_nothing(rig: Rig) -> None:
    rig.call("aspirate", volume_ul=900.0, rate_ul_s=rig.case.rate_ul_s)
    starts = rig.starts()
    with pytest.raises(PreconditionError) as caught:
        rig.call("aspirate", volume_ul=400.0, rate_ul_s=rig.case.rate_ul_s)
    assert caught.value.code == "device.stroke_out_of_range"
    assert rig.starts() == starts


@every_pump
def test_a_stop_in_mid_stroke_says_how_much_went(rig: Rig) -> None:
    before_ul = rig.vessel_ul(0)
    failures: list[DeviceError] = []

    def stop() -> None:
        try:
            rig.driver.stop()
        except DeviceError as error:
            failures.append(error)

    timer = threading.Timer(0.02, stop)
    rig.when_acting = timer.start
    with pytest.raises(DeviceStoppedError) as caught:
        rig.call("aspirate", volume_ul=1000.0, rate_ul_s=rig.case.rate_ul_s)
    timer.join()
    assert caught.value.effect is Effect.PARTIAL
    went_ul = before_ul - rig.vessel_ul(0)
    assert caught.value.context["moved_ul"] == pytest.approx(went_ul, abs=0.5)
    assert all(failure.code == "device.cannot_stop" for failure in failures)


@every_pump
def test_after_a_stop_nothing_is_sent_until_it_is_cleared(rig: Rig) -> None:
    rig.driver.stop()
    rig.sent.clear()
    with pytest.raises(DeviceStoppedError):
        rig.call("aspirate", volume_ul=400.0, rate_ul_s=rig.case.rate_ul_s)
    assert rig.sent == []
    rig.driver.clear_stop()
    assert rig.call("aspirate", volume_ul=400.0, rate_ul_s=rig.case.rate_ul_s).moved_ul
