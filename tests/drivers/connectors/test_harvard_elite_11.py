"""The Elite 11 against bytes of its published command table."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connectors.harvard_elite_11 import HarvardElite11, decode_quantity, decode_reply
from labweb.domain.errors import Effect, FrameError, PreconditionError, RejectedError
from tests.drivers.conftest import Play

CONFIG = {"syringe_ul": 10_000.0, "diameter_mm": 14.567}


def test_a_transcript_of_a_stroke(play: Play) -> None:
    device = HarvardElite11(play("harvard_elite_11"), CONFIG)
    device.connect()
    report = device.withdraw(400.0, 400.0)
    assert report.moved_ul == 400.0


def test_another_model_is_refused(play: Play) -> None:
    text = "> 0ver\\r\\n\n< \\r\\n00:PHD ULTRA 2.0\\r\\n\n"
    with pytest.raises(RejectedError, match="11 ELITE"):
        HarvardElite11(play(text=text), CONFIG).connect()


@pytest.mark.parametrize("words", ["Out of range", "Argument error", "Unknown command"])
def test_what_the_pump_does_not_take_has_no_effect(play: Play, words: str) -> None:
    text = "> 0diameter\\r\\n\n< \\r\\n00:14.5670 mm\\r\\n\n"
    text += f"> 0diameter 14.5670\\r\\n\n< \\r\\n00:{words}\\r\\n\n"
    with pytest.raises(RejectedError, match=words) as caught:
        HarvardElite11(play(text=text), CONFIG).infuse(400.0, 400.0)
    assert caught.value.effect is Effect.NONE


def test_the_published_limits_of_rate_follow_the_diameter(play: Play) -> None:
    transport = play(text="")
    # lim: "5.15 nl/min to 5.35 ml/min" belongs to a syringe of 5.975 mm.
    device = HarvardElite11(transport, {"syringe_ul": 1000.0, "diameter_mm": 5.975})
    for rate_ul_s in (5.36e3 / 60, 5.14e-3 / 60):
        with pytest.raises(PreconditionError) as caught:
            device.infuse(0.5, rate_ul_s)
        assert caught.value.code == "device.rate_out_of_range"
    assert transport.sent == []


@pytest.mark.parametrize(
    ("text", "value"),
    [("2.000 ml/min", 2000 / 60), ("5.15 nl/min", 5.15e-3 / 60), ("0.4 ml", 400.0)],
)
def test_quantities_are_read_in_any_unit(text: str, value: float) -> None:
    assert decode_quantity(text) == pytest.approx(value)


@given(st.binary(max_size=48))
def test_any_bytes_are_an_answer_or_a_frame_error(frame: bytes) -> None:
    try:
        reply = decode_reply(frame, 0)
    except FrameError:
        return
    assert reply.prompt in {":", ">", "<", "T*", "*"}
