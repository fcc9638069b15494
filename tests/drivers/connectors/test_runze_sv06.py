"""The SV-06 valve against bytes of its published command table."""

from __future__ import annotations

import pytest

from drivers.connectors._runze import decode_reply, encode_request
from drivers.connectors.runze_sv06 import RunzeSv06
from labweb.domain.errors import FrameError, PreconditionError, RejectedError
from tests.drivers.conftest import Play

CONFIG = {"address_index": 4, "ports_count": 6}


def test_a_transcript_of_a_turn(play: Play) -> None:
    device = RunzeSv06(play("runze_sv06"), CONFIG)
    device.connect()
    assert device.select_port(3).evidence == {"port_index": 3}


def test_another_address_than_asked_for_is_refused(play: Play) -> None:
    text = "> \\xcc\\x04 \\x00\\x00\\xdd\\xcd\\x01\n< \\xcc\\x04\\x00\\x05\\x00\\xdd\\xb2\\x01\n"
    with pytest.raises(RejectedError):
        RunzeSv06(play(text=text), CONFIG).connect()


def test_an_answer_of_another_unit_or_with_a_wrong_sum_is_a_frame_error() -> None:
    good = bytes.fromhex("CC 04 00 03 00 DD B0 01")
    assert decode_reply(good, 4).value == 3
    for address, frame in ((5, good), (4, good[:-1] + b"\x00"), (4, good[:7])):
        with pytest.raises(FrameError):
            decode_reply(frame, address)


def test_a_port_the_head_does_not_have_is_refused(play: Play) -> None:
    transport = play(text="")
    with pytest.raises(PreconditionError):
        RunzeSv06(transport, CONFIG).select_port(7)
    assert transport.sent == []


def test_the_sum_goes_low_byte_first() -> None:
    assert encode_request(0xFF, 0xFF, 0xFFFF)[-2:] == (0xCC + 0xDD + 4 * 0xFF).to_bytes(2, "little")
