"""The 323Du against bytes of its published command table."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connectors.watson_marlow_323 import WatsonMarlow323, decode_status
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.conftest import Play

CONFIG = {"per_turn_ul": 750.0}
STANDS = "> 1RS\\r\n< 1RS\\r323Du 0 CW 0 !\\r\n"
SET = "> 1SP40\\r\n< 1SP40\\r\n> 1RR\\r\n< 1RR\\r\n"


def test_a_transcript_of_a_flow(play: Play) -> None:
    device = WatsonMarlow323(play("watson_marlow_323"), CONFIG)
    device.connect()
    assert device.start_flow(500.0).evidence["speed_rpm"] == 40
    assert device.stop_flow().evidence == {"is_running": False}


def test_another_model_is_refused(play: Play) -> None:
    with pytest.raises(RejectedError, match="323Du"):
        WatsonMarlow323(play(text="> 1RS\\r\n< 1RS\\r530Du 0 CW 0 !\\r\n"), CONFIG).connect()


@pytest.mark.parametrize("held", ["30 CW", "40 CCW"])
def test_a_setting_that_was_not_taken_starts_nothing(play: Play, held: str) -> None:
    text = SET + f"> 1RS\\r\n< 1RS\\r323Du {held} 0 !\\r\n"
    with pytest.raises(RejectedError) as caught:
        WatsonMarlow323(play(text=text), CONFIG).start_flow(500.0)
    assert caught.value.effect is Effect.NONE


def test_a_pump_that_was_told_to_run_and_stands_is_in_doubt(play: Play) -> None:
    told = "> 1RS\\r\n< 1RS\\r323Du 40 CW 0 !\\r\n"
    text = SET + told + "> 1GO\\r\n< 1GO\\r\n" + told
    with pytest.raises(DeviceError) as caught:
        WatsonMarlow323(play(text=text), CONFIG).start_flow(500.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_a_delivery_whose_start_is_not_answered_is_stopped_and_in_doubt(play: Play) -> None:
    text = STANDS + SET
    text += "> 1RS\\r\n< 1RS\\r323Du 40 CW 0 !\\r\n> 1GO\\r\n< 1GO\\r\n> 1RS\\r\n"
    transport = play(text=text + "> 1ST\\r\n< 1ST\\r\n> 1RS\\r\n< 1RS\\r323Du 40 CW 0 !\\r\n")
    with pytest.raises(DeviceTimeoutError) as caught:
        WatsonMarlow323(transport, CONFIG).deliver(200.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN
    assert b"1ST\r" in transport.sent


def test_a_pump_that_was_told_to_stop_and_runs_is_an_error(play: Play) -> None:
    text = "> 1ST\\r\n< 1ST\\r\n> 1RS\\r\n< 1RS\\r323Du 40 CW 1 !\\r\n"
    with pytest.raises(DeviceError, match="told to stop"):
        WatsonMarlow323(play(text=text), CONFIG).stop()


@given(st.binary(max_size=48))
def test_any_bytes_are_a_status_or_a_frame_error(frame: bytes) -> None:
    try:
        decode_status(frame)
    except FrameError:
        return


@pytest.mark.parametrize("echo", ["1SP45\\r", "1SP40#\\r"])
def test_a_setting_that_is_echoed_otherwise_starts_nothing(play: Play, echo: str) -> None:
    with pytest.raises(FrameError, match="echo") as caught:
        WatsonMarlow323(play(text=f"> 1SP40\\r\n< {echo}\n"), CONFIG).start_flow(500.0)
    assert caught.value.effect is Effect.NONE


def test_a_pump_whose_echo_is_off_is_not_connected(play: Play) -> None:
    with pytest.raises(FrameError, match="echo"):
        WatsonMarlow323(play(text="> 1RS\\r\n< 323Du 0 CW 0 !\\r\n"), CONFIG).connect()


def test_a_start_whose_echo_is_lost_may_have_begun(play: Play) -> None:
    told = "> 1RS\\r\n< 1RS\\r323Du 40 CW 0 !\\r\n> 1GO\\r\n"
    with pytest.raises(DeviceTimeoutError) as caught:
        WatsonMarlow323(play(text=SET + told), CONFIG).start_flow(500.0)
    assert caught.value.effect is Effect.UNKNOWN


@pytest.mark.parametrize("action", ["start_flow", "deliver"])
def test_a_rate_between_two_whole_speeds_is_refused_with_both(play: Play, action: str) -> None:
    device = WatsonMarlow323(play(text=""), {"per_turn_ul": 800.0})
    args = {"rate_ul_s": 500.0, **({"volume_ul": 200.0} if action == "deliver" else {})}
    with pytest.raises(
        PreconditionError, match=r"37\.5 rpm.*493\.333 µL/s.*506\.667 µL/s"
    ) as caught:
        getattr(device, action)(**args)
    assert (caught.value.code, caught.value.effect) == ("device.resolution", Effect.NONE)


def test_a_rate_that_is_written_as_the_refusal_tells_it_is_taken(play: Play) -> None:
    told = "> 1RS\\r\n< 1RS\\r323Du 37 CW 1 !\\r\n"
    text = "> 1SP37\\r\n< 1SP37\\r\n> 1RR\\r\n< 1RR\\r\n" + told
    text += "> 1GO\\r\n< 1GO\\r\n" + told
    device = WatsonMarlow323(play(text=text), {"per_turn_ul": 800.0})
    assert device.start_flow(493.333).evidence["speed_rpm"] == 37
