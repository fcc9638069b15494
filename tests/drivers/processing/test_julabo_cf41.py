"""The CF41 against bytes of its published command table."""

import pytest

from drivers.processing.julabo_cf41 import JulaboCf41
from labweb.domain.errors import DeviceError, Effect, RejectedError
from tests.drivers.conftest import Play

CHECKS = (
    "> STATUS\\r\\n\n< 02 REMOTE STOP\\r\\n\n> IN_MODE_01\\r\\n\n< 0\\r\\n\n"
    "> IN_PV_00\\r\\n\n< 22.00\\r\\n\n"
)
START = (
    "> OUT_MODE_04 0\\r\\n\n> IN_MODE_04\\r\\n\n< 0\\r\\n\n"
    "> OUT_SP_00 60\\r\\n\n> IN_SP_00\\r\\n\n< 60.00\\r\\n\n> OUT_MODE_05 1\\r\\n\n"
)
REPORT = "> IN_PV_00\\r\\n\n< 59.90\\r\\n\n> IN_SP_00\\r\\n\n< 60.00\\r\\n\n"


def circulator(transport: object) -> JulaboCf41:
    return JulaboCf41(transport, {"poll_s": 0.005, "settle_s": 0.0, "gap_s": 0.0})  # type: ignore[arg-type]


def test_it_heats_under_control_and_reads_back_what_it_sets(play: Play) -> None:
    text = (
        CHECKS + START + "> STATUS\\r\\n\n< 03 REMOTE START\\r\\n\n> IN_MODE_05\\r\\n\n< 1\\r\\n\n"
        "> IN_PV_00\\r\\n\n< 59.90\\r\\n\n" + REPORT
    )
    report = circulator(play(text=text)).reach_temperature(60.0, 1.0)
    assert report.evidence == {"temperature_c": 59.9, "temperature_setpoint_c": 60.0}


def test_one_that_is_driven_by_hand_is_left_alone(play: Play) -> None:
    with pytest.raises(RejectedError, match="remote") as caught:
        circulator(play(text="> STATUS\\r\\n\n< 01 MANUAL START\\r\\n\n")).reach_temperature(
            60.0, 1.0
        )
    assert caught.value.effect is Effect.NONE


def test_a_fault_of_the_bath_ends_the_action(play: Play) -> None:
    text = (
        CHECKS
        + START
        + "> STATUS\\r\\n\n< -14 EXCESS TEMPERATURE\\r\\n\n> OUT_MODE_05 0\\r\\n\n"
        + REPORT
    )
    with pytest.raises(DeviceError, match="-14") as caught:
        circulator(play(text=text)).reach_temperature(60.0, 1.0)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.PARTIAL)


def test_a_low_level_is_only_a_warning(play: Play) -> None:
    text = (
        CHECKS.replace("02 REMOTE STOP", "-40 LEVEL")
        + START
        + "> STATUS\\r\\n\n< -40 LEVEL\\r\\n\n"
        "> IN_MODE_05\\r\\n\n< 1\\r\\n\n> IN_PV_00\\r\\n\n< 59.90\\r\\n\n" + REPORT
    )
    circulator(play(text=text)).reach_temperature(60.0, 1.0)


def test_a_bath_that_went_off_by_itself_is_not_waited_for(play: Play) -> None:
    text = (
        CHECKS + START + "> STATUS\\r\\n\n< 02 REMOTE STOP\\r\\n\n> IN_MODE_05\\r\\n\n< 0\\r\\n\n"
        "> OUT_MODE_05 0\\r\\n\n" + REPORT
    )
    with pytest.raises(DeviceError, match="by itself"):
        circulator(play(text=text)).reach_temperature(60.0, 1.0)
