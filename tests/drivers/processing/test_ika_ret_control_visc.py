"""The RET control-visc against bytes of its published command table."""

import pytest

from drivers.processing.ika_ret_control_visc import IkaRetControlVisc
from labweb.domain.errors import DeviceError, Effect, PreconditionError, RejectedError
from tests.drivers.conftest import Play


def plate(transport: object, **config: object) -> IkaRetControlVisc:
    return IkaRetControlVisc(transport, {"poll_s": 0.005, "settle_s": 0.0, **config})  # type: ignore[arg-type]


@pytest.mark.parametrize(("sensor", "channel"), [("external", 1), ("plate", 2)])
def test_medium_and_plate_have_a_setpoint_each(play: Play, sensor: str, channel: int) -> None:
    text = (
        f">* IN_PV_{channel}\\r\\n\n< 59.9 {channel}\\r\\n\n"
        f"> OUT_SP_{channel} 60\\r\\n\n> IN_SP_{channel}\\r\\n\n< 60.0 {channel}\\r\\n\n"
        f"> START_1\\r\\n\n>* IN_PV_{channel}\\r\\n\n< 59.9 {channel}\\r\\n\n"
        f"> IN_SP_{channel}\\r\\n\n< 60.0 {channel}\\r\\n\n"
    )
    assert plate(play(text=text), sensor=sensor).heat_to(60.0, 1.0).evidence == {
        "temperature_c": 59.9,
        "temperature_setpoint_c": 60.0,
    }


def test_a_plate_that_a_person_named_is_found_by_that_name(play: Play) -> None:
    answer = "> IN_NAME\\r\\n\n< LEFT\\r\\n\n"
    plate(play(text=answer), name="LEFT").connect()
    with pytest.raises(RejectedError, match="LEFT") as caught:
        plate(play(text=answer)).connect()
    assert caught.value.effect is Effect.NONE


def test_a_setpoint_that_is_not_taken_turns_the_heater_off(play: Play) -> None:
    text = (
        "> IN_PV_1\\r\\n\n< 22.0 1\\r\\n\n> OUT_SP_1 60\\r\\n\n"
        "> IN_SP_1\\r\\n\n< 22.0 1\\r\\n\n> STOP_1\\r\\n\n"
        "> IN_PV_1\\r\\n\n< 22.0 1\\r\\n\n> IN_SP_1\\r\\n\n< 22.0 1\\r\\n\n"
    )
    transport = play(text=text)
    with pytest.raises(RejectedError) as caught:
        plate(transport).heat_to(60.0, 1.0)
    assert caught.value.effect is Effect.PARTIAL
    assert b"START_1\r\n" not in transport.sent


def test_a_limit_of_this_lab_is_kept_before_a_byte_is_sent(play: Play) -> None:
    transport = play(text="")
    with pytest.raises(PreconditionError):
        plate(transport, max_temperature_c=80.0).heat_to(81.0, 1.0)
    assert transport.sent == []


def test_silence_once_it_heats_is_unknown(play: Play) -> None:
    text = (
        "> IN_PV_1\\r\\n\n< 22.0 1\\r\\n\n> OUT_SP_1 60\\r\\n\n"
        "> IN_SP_1\\r\\n\n< 60.0 1\\r\\n\n> START_1\\r\\n\n> IN_PV_1\\r\\n\n> STOP_1\\r\\n\n"
    )
    with pytest.raises(DeviceError) as caught:
        plate(play(text=text)).heat_to(60.0, 1.0)
    assert caught.value.effect is Effect.UNKNOWN
