"""The NE-1000 against bytes of its published command table."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connectors.new_era_ne1000 import NewEraNe1000, decode_reply, encode_number
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError
from tests.drivers.conftest import Play

CONFIG = {"syringe_ul": 10_000.0, "diameter_mm": 14.567}


def test_a_transcript_of_a_stroke_after_a_reset(play: Play) -> None:
    device = NewEraNe1000(play("new_era_ne1000"), CONFIG)
    device.connect()
    report = device.withdraw(400.0, 100.0)
    assert report.moved_ul == 400.0


def test_the_first_command_after_the_start_may_be_lost(play: Play) -> None:
    text = "> 00 DIA\\r\n> 00 DIA\\r\n< \\x0200A?R\\x03\n> 00 DIA\\r\n< \\x0200S14.57\\x03\n"
    NewEraNe1000(play(text=text), CONFIG).connect()


@pytest.mark.parametrize(("letter", "word"), [("R", "reset"), ("S", "stall"), ("E", "program")])
def test_an_alarm_before_a_stroke_has_no_effect_and_is_named(
    play: Play, letter: str, word: str
) -> None:
    device = NewEraNe1000(play(text=f"> 00 DIS\\r\n< \\x0200A?{letter}\\x03\n"), CONFIG)
    with pytest.raises(DeviceError, match=word) as caught:
        device.infuse(400.0, 100.0)
    assert caught.value.effect is Effect.NONE


def test_what_the_pump_does_not_take_is_refused(play: Play) -> None:
    text = "> 00 DIS\\r\n< \\x0200SI0.000W0.000ML\\x03\n> 00 DIA 14.57\\r\n< \\x0200S?OOR\\x03\n"
    with pytest.raises(RejectedError, match="OOR"):
        NewEraNe1000(play(text=text), CONFIG).infuse(400.0, 100.0)


@given(st.floats(min_value=0.001, max_value=9999.0))
def test_a_number_has_four_digits_at_most(value: float) -> None:
    text = encode_number(value)
    assert sum(sign.isdigit() for sign in text) <= 5
    assert float(text) == pytest.approx(value, abs=10 ** (len(str(int(value))) - 4))


@given(st.binary(max_size=48))
def test_any_bytes_are_an_answer_or_a_frame_error(frame: bytes) -> None:
    try:
        reply = decode_reply(frame, 0)
    except FrameError:
        return
    assert reply.prompt in "IWSPTUXA"
