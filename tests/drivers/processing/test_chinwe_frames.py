"""Frames of the separator's motors and of its sensor, as their tables have them."""

from __future__ import annotations

import pytest

from drivers.processing._emm import STATUS, decode_answer, decode_signed, decode_taken
from drivers.processing._xkc import crc_of, decode_level, decode_words, encode_read
from labweb.domain.errors import Effect, FrameError, RejectedError
from tests.drivers.chinwe import checked


def test_the_check_is_that_of_modbus() -> None:
    assert crc_of(bytes.fromhex("010300000001")).hex() == "840a"  # Modbus, a common example
    assert encode_read(6, 1, 2).hex() == "060300010002947c"


@pytest.mark.parametrize(
    "frame",
    [
        "043a036c",  # last byte
        "053a036b",  # another motor
        "0435036b",  # another command
        "043a6b",  # short
        "043a03006b",  # long
        "0400e16b",  # an error that the manual does not have
    ],
)
def test_a_motor_that_answers_wrongly_is_a_frame_error(frame: str) -> None:
    with pytest.raises(FrameError):
        decode_answer(bytes.fromhex(frame), 4, STATUS)


@pytest.mark.parametrize("frame", ["04f3e26b", "0400ee6b"])
def test_a_motor_that_refuses_did_not_move(frame: str) -> None:
    with pytest.raises(RejectedError) as caught:
        decode_taken(bytes.fromhex(frame), 4, 0xF3)
    assert caught.value.effect is Effect.NONE


def test_a_status_that_the_manual_does_not_have_is_a_frame_error() -> None:
    with pytest.raises(FrameError, match="0x9f"):
        decode_taken(bytes.fromhex("05fd9f6b"), 5, 0xFD)
    with pytest.raises(FrameError, match="sign"):
        decode_signed(bytes.fromhex("0200004000"))


@pytest.mark.parametrize(
    "frame",
    [
        checked("0603040001026c")[:-2] + "00",  # check
        checked("0703040001026c"),  # another unit
        checked("0604040001026c"),  # another function
        checked("0603020001"),  # too few registers
        "0603",  # short
    ],
)
def test_a_sensor_that_answers_wrongly_is_a_frame_error(frame: str) -> None:
    with pytest.raises(FrameError):
        decode_words(bytes.fromhex(frame), 6, 2)


def test_an_exception_of_the_sensor_is_a_refusal_and_an_odd_output_is_none() -> None:
    with pytest.raises(RejectedError, match="illegal register address"):
        decode_words(bytes.fromhex(checked("068302")), 6, 2)
    with pytest.raises(FrameError):
        decode_level((2, 600))
