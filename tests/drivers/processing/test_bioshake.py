"""The BioShake against bytes of its published command table."""

import pytest

from drivers.processing.bioshake import Bioshake
from labweb.domain.errors import DeviceError, Effect, FrameError, PreconditionError, RejectedError
from tests.drivers.conftest import Play


def ask(command: str, answer: str) -> str:
    return f"> {command}\\r\n< {answer}\\r\\n\n"


LIMITS = ask("getShakeMinRpm", "200") + ask("getShakeMaxRpm", "3000")
START = (
    ask("setElmLockPos", "ok")
    + ask("setShakeAcceleration5", "ok")
    + ask("setShakeTargetSpeed500", "ok")
    + ask("shakeOn", "ok")
)


def shaker(transport: object, **config: object) -> Bioshake:
    settings = {"poll_s": 0.005, "settle_s": 0.0, "stand_s": 0.0, **config}
    return Bioshake(transport, settings)  # type: ignore[arg-type]


def test_the_plate_is_locked_before_it_is_shaken(play: Play) -> None:
    text = LIMITS + START + ask("getShakeActualSpeed", "499") + ask("getShakeActualSpeed", "500")
    assert shaker(play(text=text)).shake(500.0, 5.0).evidence == {"speed_rpm": 500.0}


def test_a_lock_that_fails_starts_nothing(play: Play) -> None:
    text = (
        LIMITS + ask("setElmLockPos", "e") + ask("shakeOff", "ok") + ask("getShakeActualSpeed", "0")
    )
    transport = play(text=text)
    with pytest.raises(RejectedError) as caught:
        shaker(transport).shake(500.0, 5.0)
    assert caught.value.effect is Effect.PARTIAL
    assert b"shakeOn\r" not in transport.sent


def test_a_speed_is_not_reached_in_time(play: Play) -> None:
    text = (
        LIMITS
        + START
        + ">* getShakeActualSpeed\\r\n< 0\\r\\n\n"
        + ask("shakeOff", "ok")
        + ask("getShakeActualSpeed", "0")
    )
    with pytest.raises(DeviceError) as caught:
        shaker(play(text=text), speed_limit_s=0.1).shake(500.0, 5.0)
    assert (caught.value.code, caught.value.effect) == ("device.not_reached", Effect.PARTIAL)


def test_tenths_of_a_degree_are_sent(play: Play) -> None:
    text = (
        ask("getTempMin", "0.0")
        + ask("getTempMax", "99.0")
        + ask("getTempActual", "22.0")
        + ask("setTempTarget375", "ok")
        + ask("tempOn", "ok")
        + ask("getTempActual", "37.4")
        + ask("getTempActual", "37.4")
    )
    assert shaker(play(text=text)).reach_temperature(37.5, 0.5).evidence == {"temperature_c": 37.4}


def test_clamps_of_a_shaker_that_moves_are_refused(play: Play) -> None:
    with pytest.raises(RejectedError) as caught:
        shaker(play(text=ask("setElmUnlockPos", "e"))).unlock_plate()
    assert caught.value.effect is Effect.NONE


def test_a_limit_of_this_lab_is_kept(play: Play) -> None:
    with pytest.raises(PreconditionError):
        shaker(play(text=""), max_speed_rpm=400.0).shake(500.0, 5.0)


@pytest.mark.parametrize("answer", ["fast", "4x0", "\\xb400"])
def test_a_garbled_number_is_a_frame_error(play: Play, answer: str) -> None:
    with pytest.raises(FrameError):
        shaker(play(text=ask("getShakeActualSpeed", answer))).speed_rpm()
