"""The Azura Compact against bytes of its published command table."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connectors.knauer_azura_compact import KnauerAzuraCompact, decode_reply
from labweb.domain.errors import Effect, FrameError, PreconditionError, RejectedError
from tests.drivers.conftest import Play

CONFIG = {"head": 50}


def test_a_transcript_of_a_flow(play: Play) -> None:
    device = KnauerAzuraCompact(play("knauer_azura_compact"), CONFIG)
    device.connect()
    assert device.start_flow(500.0).evidence == {"rate_ul_s": 500.0}
    device.stop_flow()


def test_another_pump_head_is_refused(play: Play) -> None:
    with pytest.raises(RejectedError, match="head 10"):
        KnauerAzuraCompact(play(text="> HEADTYPE?\\n\\r\n< HEADTYPE:10\\r\n"), CONFIG).connect()


def test_a_setpoint_that_the_pump_refuses_starts_nothing(play: Play) -> None:
    text = "> FLOW:30000\\n\\r\n< ERROR:2\\r\n"
    with pytest.raises(RejectedError, match="setpoint refused") as caught:
        KnauerAzuraCompact(play(text=text), CONFIG).start_flow(500.0)
    assert caught.value.effect is Effect.NONE


@pytest.mark.parametrize(("head", "rate_ul_s"), [(10, 167.0), (50, 834.0), (50, 0.01)])
def test_a_flow_that_the_head_cannot_do_is_refused(play: Play, head: int, rate_ul_s: float) -> None:
    transport = play(text="")
    with pytest.raises(PreconditionError):
        KnauerAzuraCompact(transport, {"head": head}).start_flow(rate_ul_s)
    assert transport.sent == []


@given(st.binary(max_size=48))
def test_any_bytes_are_an_answer_or_an_error_of_ours(frame: bytes) -> None:
    try:
        decode_reply(frame, "FLOW")
    except (FrameError, RejectedError):
        return
