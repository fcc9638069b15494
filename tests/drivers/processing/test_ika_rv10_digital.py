"""The RV10 digital against bytes of its published command table."""

import pytest

from drivers.processing.ika_rv10_digital import IkaRv10Digital
from labweb.domain.errors import DeviceError, Effect
from tests.drivers.conftest import Play

FINE = "> STATUS\\r\\n\n< 1\\r\\n\n"


def evaporator(transport: object) -> IkaRv10Digital:
    return IkaRv10Digital(transport, {"poll_s": 0.005, "settle_s": 0.0, "lift_s": 0.01})  # type: ignore[arg-type]


def test_what_follows_the_name_is_a_version(play: Play) -> None:
    evaporator(play(text="> IN_NAME\\r\\n\n< RV10Digital 1.2\\r\\n\n")).connect()


def test_up_is_62_and_down_is_63(play: Play) -> None:
    device = evaporator(
        play(text=FINE + "> OUT_SP_62 1\\r\\n\n" + FINE + FINE + "> OUT_SP_63 1\\r\\n\n" + FINE)
    )
    device.raise_flask()
    device.lower_flask()


def test_a_fault_before_the_start_moves_nothing(play: Play) -> None:
    transport = play(text="> STATUS\\r\\n\n< E02\\r\\n\n")
    with pytest.raises(DeviceError, match="no connection") as caught:
        evaporator(transport).heat_bath_to(60.0, 1.0)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.NONE)
    assert transport.sent == [b"STATUS\r\n"]


def test_a_fault_while_it_heats_turns_the_bath_off(play: Play) -> None:
    text = (
        FINE + "> OUT_SP_2 60\\r\\n\n> IN_SP_2\\r\\n\n< 60.0 2\\r\\n\n> START_2\\r\\n\n"
        "> STATUS\\r\\n\n< E02\\r\\n\n> STOP_2\\r\\n\n"
        "> IN_PV_2\\r\\n\n< 30.0 2\\r\\n\n> IN_SP_2\\r\\n\n< 60.0 2\\r\\n\n"
    )
    with pytest.raises(DeviceError) as caught:
        evaporator(play(text=text)).heat_bath_to(60.0, 1.0)
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["bath_temperature_c"] == 30.0


def test_the_flask_turns_and_stands_again(play: Play) -> None:
    text = (
        FINE + "> OUT_SP_4 100\\r\\n\n> IN_SP_4\\r\\n\n< 100 4\\r\\n\n> START_4\\r\\n\n"
        ">* IN_PV_4\\r\\n\n< 99 4\\r\\n\n> IN_SP_4\\r\\n\n< 100 4\\r\\n\n> STOP_4\\r\\n\n"
        ">* IN_PV_4\\r\\n\n< 0 4\\r\\n\n> IN_SP_4\\r\\n\n< 100 4\\r\\n\n"
    )
    device = evaporator(play(text=text))
    assert device.rotate(100.0).evidence["speed_rpm"] == 99.0
    assert device.stop_rotating().evidence["speed_rpm"] == 0.0
