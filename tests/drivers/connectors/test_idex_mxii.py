"""The MX II valve against bytes of its published command table."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connectors.idex_mxii import ERRORS, IdexMxii, decode_status, encode_move
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError
from tests.drivers.conftest import Play

CONFIG = {"ports_count": 10}


def test_a_transcript_of_a_turn(play: Play) -> None:
    device = IdexMxii(play("idex_mxii"), CONFIG)
    device.connect()
    assert device.select_port(3).evidence == {"port_index": 3}


def test_positions_are_hexadecimal_both_ways() -> None:
    assert encode_move(10) == b"P0A\r"
    assert decode_status(b"0A\r") == 10


@pytest.mark.parametrize("answer", ["*", "77"])
def test_a_turn_that_is_not_taken_has_no_effect(play: Play, answer: str) -> None:
    with pytest.raises(RejectedError) as caught:
        IdexMxii(play(text=f"> P03\\r\n< {answer}\\r\n"), CONFIG).select_port(3)
    assert caught.value.effect is Effect.NONE


@pytest.mark.parametrize("code", sorted(ERRORS))
def test_an_error_after_the_turn_is_in_doubt_and_named(play: Play, code: str) -> None:
    text = f"> P03\\r\n< \\r\n> S\\r\n< {code}\\r\n"
    with pytest.raises(DeviceError, match=ERRORS[code]) as caught:
        IdexMxii(play(text=text), CONFIG).select_port(3)
    assert caught.value.effect is Effect.UNKNOWN
    assert caught.value.context == {"error_code": int(code)}


def test_a_valve_that_stands_elsewhere_is_partial(play: Play) -> None:
    text = "> P03\\r\n< \\r\n> S\\r\n< 02\\r\n> S\\r\n< 02\\r\n"
    with pytest.raises(DeviceError) as caught:
        IdexMxii(play(text=text), CONFIG).select_port(3)
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context == {"moved_ul": 0.0, "port_index": 2}


@given(st.binary(max_size=16))
def test_any_bytes_are_a_status_or_an_error_of_ours(frame: bytes) -> None:
    try:
        decode_status(frame)
    except (FrameError, DeviceError):
        return
