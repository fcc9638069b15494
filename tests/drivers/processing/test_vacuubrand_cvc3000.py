"""The CVC 3000 against bytes of its published command table."""

import pytest

from drivers.processing.vacuubrand_cvc3000 import (
    VacuubrandCvc3000,
    decode_digits,
    decode_pressure,
)
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError
from tests.drivers.conftest import Play

NAME = "> CVC 3000\\r\\n\n< 3\\r\\n\n> ECHO 1\\r\\n\n< 1\\r\\n\n"
REMOTE = "> REMOTE 1\\r\\n\n< 1\\r\\n\n"
HALT = NAME + REMOTE + "> STOP 1\\r\\n\n< 1\\r\\n\n> OUT_VENT 0\\r\\n\n< 0\\r\\n\n"
CHECKS = "> IN_PV_1\\r\\n\n< 1013.0 mbar\\r\\n\n> IN_ERR\\r\\n\n< 000000000\\r\\n\n"
START = (
    REMOTE + "> OUT_MODE 2\\r\\n\n< 2\\r\\n\n> OUT_SP_1 200\\r\\n\n< 0200\\r\\n\n"
    "> START 1\\r\\n\n< 1\\r\\n\n"
)
REPORT = "> IN_PV_1\\r\\n\n< 0205.0 mbar\\r\\n\n> IN_SP_1\\r\\n\n< 0200 mbar\\r\\n\n"


def controller(transport: object) -> VacuubrandCvc3000:
    return VacuubrandCvc3000(transport, {"poll_s": 0.005, "settle_s": 0.0, "gap_s": 0.0})  # type: ignore[arg-type]


def test_connecting_chooses_the_command_set_and_echoes(play: Play) -> None:
    controller(play(text=NAME + "> IN_VER\\r\\n\n< CVC 3000 V 2.00\\r\\n\n")).connect()


def test_it_pumps_down_to_a_pressure_in_kilopascal(play: Play) -> None:
    text = (
        CHECKS + START + "> IN_ERR\\r\\n\n< 000000000\\r\\n\n> IN_STAT\\r\\n\n< 100021\\r\\n\n"
        "> IN_PV_1\\r\\n\n< 0205.0 mbar\\r\\n\n" + REPORT
    )
    assert controller(play(text=text)).evacuate_to(20.0, 1.0).evidence == {
        "pressure_kpa": 20.5,
        "pressure_setpoint_kpa": 20.0,
    }


def test_a_full_catch_pot_turns_the_pump_off(play: Play) -> None:
    text = CHECKS + START + "> IN_ERR\\r\\n\n< 000000010\\r\\n\n" + HALT + REPORT
    with pytest.raises(DeviceError, match="catch pot") as caught:
        controller(play(text=text)).evacuate_to(20.0, 1.0)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.PARTIAL)


def test_a_vent_valve_that_shut_under_vacuum_is_no_success(play: Play) -> None:
    text = (
        "> IN_PV_1\\r\\n\n< 0205.0 mbar\\r\\n\n" + REMOTE + "> STOP 1\\r\\n\n< 1\\r\\n\n"
        "> OUT_VENT 2\\r\\n\n< 2\\r\\n\n> IN_STAT\\r\\n\n< 000020\\r\\n\n"
        "> IN_PV_1\\r\\n\n< 0205.0 mbar\\r\\n\n" + HALT + REPORT
    )
    with pytest.raises(DeviceError) as caught:
        controller(play(text=text)).vent()
    assert caught.value.code == "device.not_reached"


def test_another_unit_is_refused_and_not_converted() -> None:
    with pytest.raises(RejectedError, match="Torr"):
        decode_pressure("0760.0 Torr")


@pytest.mark.parametrize("text", ["10002", "1000211", "10002x", ""])
def test_a_state_of_other_length_is_a_frame_error(text: str) -> None:
    with pytest.raises(FrameError):
        decode_digits(text, 6)
