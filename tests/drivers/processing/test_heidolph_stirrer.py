"""Hei-TORQUE 100 and RZR 2052 against bytes of its published command table."""

import pytest

from drivers.processing.heidolph_stirrer import HeidolphStirrer
from labweb.domain.errors import DeviceError, Effect, PreconditionError
from tests.drivers.conftest import Play

FINE = "> f\\r\\n\n< FLT: No Error!\\r\\n\n"
REPORT = "> r\\r\\n\n< RPM: 298\\r\\n\n> m\\r\\n\n< NCM: 5\\r\\n\n"


def stirrer(transport: object, model: str = "hei_torque_100") -> HeidolphStirrer:
    return HeidolphStirrer(transport, {"model": model, "poll_s": 0.005})  # type: ignore[arg-type]


def test_a_speed_is_four_digits_and_is_echoed(play: Play) -> None:
    text = (
        FINE + "> R0300\\r\\n\n< SET: 300\\r\\n\n" + FINE + "> r\\r\\n\n< RPM: 298\\r\\n\n" + REPORT
    )
    assert stirrer(play(text=text)).stir(300.0).evidence == {"speed_rpm": 298.0, "torque_ncm": 5.0}


def test_the_models_differ_in_name_and_in_their_least_speed(play: Play) -> None:
    stirrer(play(text="> T\\r\\n\n< HT:100P\\r\\n\n" + FINE)).connect()
    other = play(text=FINE)
    device = stirrer(other, "rzr_2052")
    device.connect()
    with pytest.raises(PreconditionError, match="50"):
        device.stir(49.0)
    assert other.sent == [b"f\r\n"]


def test_a_fault_while_it_stirs_turns_the_motor_off(play: Play) -> None:
    text = (
        FINE + "> R0300\\r\\n\n< SET: 300\\r\\n\n> f\\r\\n\n< FLT: Overload!\\r\\n\n"
        "> R0000\\r\\n\n< SET: 0\\r\\n\n" + REPORT
    )
    with pytest.raises(DeviceError, match="Overload") as caught:
        stirrer(play(text=text)).stir(300.0)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.PARTIAL)


def test_a_motor_that_cannot_be_turned_off_is_unknown(play: Play) -> None:
    text = (
        FINE + "> R0300\\r\\n\n< SET: 300\\r\\n\n> f\\r\\n\n< FLT: Overload!\\r\\n\n> R0000\\r\\n\n"
    )
    with pytest.raises(DeviceError) as caught:
        stirrer(play(text=text)).stir(300.0)
    assert caught.value.effect is Effect.UNKNOWN
    assert "not_turned_off" in caught.value.context
