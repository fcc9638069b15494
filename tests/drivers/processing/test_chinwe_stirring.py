"""How the ChinWe separator stirs: with the drain closed, for a time, and then it stands."""

from __future__ import annotations

import pytest

from labweb.domain.errors import DeviceError, DeviceTimeoutError, Effect, PreconditionError
from tests.drivers.chinwe import SHUT, STANDS, ask, confirmed, separator, speed
from tests.drivers.conftest import Play

TURNS = ask("04f600012cc8006b", "04f6026b")
ENABLED = ask("043a6b", "043a016b")
TURNING = ENABLED + speed(300)


def test_it_stirs_for_its_time_and_then_stands(play: Play) -> None:
    turning = ask("043a6b", "043a016b", ">?")
    text = SHUT + turning + TURNS + speed(0) + speed(298, ">*")
    text += ask("04fe98006b", "04fe026b") + speed(120) + speed(0, ">*")
    report = confirmed(play, text, poll_s=0.01).stir(300.0, 0.1)
    assert report.evidence["speed_rpm"] == 0.0
    assert report.evidence["stirred_s"] == pytest.approx(0.1, abs=0.1)


def test_a_stirrer_that_stalls_is_stopped(play: Play) -> None:
    text = SHUT + ENABLED + TURNS + TURNING + ask("043a6b", "043a0d6b")
    error = stirred_in_vain(play, text + STANDS + speed(0))
    assert (error.code, error.effect) == ("device.alarm", Effect.PARTIAL)


def test_a_stirrer_that_does_not_come_to_its_speed_is_stopped(play: Play) -> None:
    slow = ask("043a6b", "043a016b", ">?") + speed(100, ">*") + ask("04fe98006b", "04fe026b")
    error = stirred_in_vain(play, SHUT + TURNS + slow + speed(0, ">*"))
    assert (error.code, error.effect) == ("device.not_reached", Effect.PARTIAL)


def test_a_start_that_is_refused_moved_nothing(play: Play) -> None:
    text = SHUT + ENABLED + ask("04f600012cc8006b", "04f6e26b")
    assert stirred_in_vain(play, text).effect is Effect.NONE


def test_a_start_whose_answer_is_lost_is_stopped_and_unknown(play: Play) -> None:
    error = stirred_in_vain(play, SHUT + ENABLED + ask("04f600012cc8006b") + STANDS)
    assert isinstance(error, DeviceTimeoutError)
    assert error.effect is Effect.UNKNOWN


def stirred_in_vain(play: Play, text: str) -> DeviceError:
    with pytest.raises(DeviceError) as caught:
        confirmed(play, text, poll_s=0.005).stir(300.0, 1.0)
    return caught.value


@pytest.mark.parametrize("speed_rpm", [1001.0, 300.5])
def test_a_speed_beyond_the_lab_or_between_two_steps_is_refused(
    play: Play, speed_rpm: float
) -> None:
    with pytest.raises(PreconditionError):
        separator(play(text="")).stir(speed_rpm, 1.0)
