"""The multiposition actuator against bytes of its published command table."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connectors import _motion
from drivers.connectors._vici import decode_position
from drivers.connectors.vici_multiposition import ViciMultiposition
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError
from tests.drivers.conftest import Play

CONFIG = {"ports_count": 10}


def test_a_transcript_of_a_turn(play: Play) -> None:
    device = ViciMultiposition(play("vici_multiposition"), CONFIG)
    device.connect()
    assert device.select_port(3).evidence == {"port_index": 3}


def test_the_older_firmware_tells_the_position_in_words(play: Play) -> None:
    text = "> 2GO3\\r\n> 2CP\\r\n< Position is = 1\\r\\n\n> 2CP\\r\n< Position is = 3\\r\\n\n"
    text += "> 2CP\\r\n< Position is = 3\\r\\n\n"
    device = ViciMultiposition(play(text=text), {**CONFIG, "address": "2"})
    assert device.select_port(3).evidence == {"port_index": 3}


@pytest.mark.parametrize("answer", ["CPA", "CP11"])
def test_another_valve_than_was_set_is_refused(play: Play, answer: str) -> None:
    with pytest.raises(RejectedError):
        ViciMultiposition(play(text=f"> CP\\r\n< {answer}\\r\\n\n"), CONFIG).connect()


def test_a_valve_that_never_arrives_is_in_doubt(
    play: Play, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_motion, "VALVE_S", 0.02)
    monkeypatch.setattr(_motion, "SLACK_S", 0.02)
    device = ViciMultiposition(play(text="> GO3\\r\n>* CP\\r\n< CP01\\r\\n\n"), CONFIG)
    with pytest.raises(DeviceError) as caught:
        device.select_port(3)
    assert caught.value.code == "device.slow"
    assert caught.value.effect is Effect.UNKNOWN


@given(st.binary(max_size=32))
def test_any_bytes_are_a_position_or_a_frame_error(frame: bytes) -> None:
    try:
        decode_position(frame)
    except FrameError:
        return
