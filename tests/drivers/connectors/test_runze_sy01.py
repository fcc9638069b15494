"""The SY-01 pump and valve against bytes of its published command table."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.base import DeviceStoppedError
from drivers.connectors import _motion
from drivers.connectors._runze import VALVE_TO, decode_reply, encode_request
from drivers.connectors.runze_sy01 import RunzeSy01
from drivers.transports.base import Direction
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.conftest import Play

CONFIG = {"syringe_ul": 1000.0, "full_stroke_s": 2.0, "ports_count": 6, "address_index": 3}


def reply(status: int, value: int = 0, address: int = 3) -> str:
    body = bytes((0xCC, address, status)) + value.to_bytes(2, "little") + b"\xdd"
    return as_text(body + sum(body).to_bytes(2, "little"))


def as_text(frame: bytes) -> str:
    return "".join(f"\\x{byte:02x}" for byte in frame)


def exchange(function: int, value: int = 0, *answers: str) -> str:
    lines = "".join(f"< {answer}\n" for answer in answers)
    return f"> {as_text(encode_request(3, function, value))}\n{lines}"


READY = (
    exchange(0x66, 0, reply(0)) + exchange(0x45, 0, reply(0)) + exchange(0x4A, 0, reply(0))
    + exchange(0x66, 0, reply(0)) + exchange(0x44, 1, reply(0)) + exchange(0x4A, 0, reply(0))
)  # fmt: skip


def ready(play: Play, text: str) -> RunzeSy01:
    device = RunzeSy01(play(text=READY + text), CONFIG)
    device.initialize()
    device.select_port(1)
    return device


def test_a_transcript_from_connecting_to_a_stroke(play: Play) -> None:
    device = RunzeSy01(play("runze_sy01"), CONFIG)
    device.connect()
    device.initialize()
    assert device.select_port(3).evidence == {"port_index": 3}
    report = device.aspirate(400.0, 500.0)
    assert report.moved_ul == 400.0
    assert report.evidence == {"steps_before": 0, "steps_after": 4800, "port_index": 3}


def test_the_published_example_of_a_frame() -> None:
    assert encode_request(1, VALVE_TO, 3) == bytes.fromhex("CC 01 44 03 00 DD F1 01")


def test_a_unit_that_answers_only_when_it_is_done_is_waited_for(play: Play) -> None:
    text = exchange(0x66, 0, reply(0)) + exchange(0x43, 4800, reply(0))
    text += exchange(0x4A, 0, reply(0)) + exchange(0x66, 0, reply(0, 4800))
    assert ready(play, text).aspirate(400.0, 500.0).moved_ul == 400.0


@pytest.mark.parametrize("status", [0x01, 0x02, 0x04])
def test_a_refused_move_has_no_effect(play: Play, status: int) -> None:
    text = exchange(0x66, 0, reply(0)) + exchange(0x43, 4800, reply(status))
    with pytest.raises(RejectedError) as caught:
        ready(play, text).aspirate(400.0, 500.0)
    assert caught.value.effect is Effect.NONE


@pytest.mark.parametrize("status", [0x03, 0x05, 0x06, 0xFF])
def test_a_motion_that_fails_is_in_doubt_and_loses_the_zero(play: Play, status: int) -> None:
    text = exchange(0x66, 0, reply(0)) + exchange(0x43, 4800, reply(0xFE))
    text += exchange(0x4A, 0, reply(status)) + exchange(0x66, 0, reply(0, 100))
    device = ready(play, text)
    with pytest.raises(DeviceError) as caught:
        device.aspirate(400.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN
    assert device.is_initialized() is False


def test_a_position_that_is_refused_after_a_stroke_leaves_it_in_doubt(play: Play) -> None:
    text = exchange(0x66, 0, reply(0)) + exchange(0x43, 4800, reply(0xFE))
    text += exchange(0x4A, 0, reply(0)) + exchange(0x66, 0, reply(0x06))
    with pytest.raises(RejectedError) as caught:
        ready(play, text).aspirate(400.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_an_answer_that_never_comes_is_in_doubt(
    play: Play, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_motion, "SLACK_S", 0.0)
    with pytest.raises(DeviceTimeoutError) as caught:
        ready(play, exchange(0x66, 0, reply(0)) + exchange(0x43, 4800)).aspirate(400.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_a_stop_while_the_answer_is_awaited_halts_and_measures(play: Play) -> None:
    text = exchange(0x66, 0, reply(0)) + exchange(0x43, 4800) + exchange(0x49, 0, reply(0))
    text += exchange(0x4A, 0, reply(0)) + exchange(0x66, 0, reply(0, 1200))
    device = ready(play, text)

    def stop(direction: Direction, data: bytes) -> None:
        if direction == "out" and data == encode_request(3, 0x43, 4800):
            device._stopping.set()

    device.transport.observer = stop
    with pytest.raises(DeviceStoppedError) as caught:
        device.aspirate(400.0, 500.0)
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["moved_ul"] == 100.0


def test_no_stroke_is_made_at_another_rate_or_before_the_zero_is_found(play: Play) -> None:
    device = RunzeSy01(play(text=""), CONFIG)
    for rate_ul_s, code in (
        (450.0, "device.rate_out_of_range"),
        (500.0, "device.not_initialized"),
    ):
        with pytest.raises(PreconditionError) as caught:
            device.aspirate(400.0, rate_ul_s)
        assert caught.value.code == code


def test_the_valve_stands_nowhere_known_before_its_first_turn(play: Play) -> None:
    assert RunzeSy01(play(text=""), CONFIG).port_index() is None


@given(st.binary(max_size=16))
def test_any_bytes_are_an_answer_or_a_frame_error(frame: bytes) -> None:
    try:
        found = decode_reply(frame, 3)
    except FrameError:
        return
    assert 0 <= found.value <= 0xFFFF
