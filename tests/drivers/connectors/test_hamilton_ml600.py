"""The ML600 pump and valve against bytes of its published command table."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connectors.hamilton_ml600 import HamiltonMl600, decode_reply
from labweb.domain.errors import DeviceError, Effect, FrameError, PreconditionError, RejectedError
from tests.drivers.conftest import Play

CONFIG = {"syringe_ul": 1000.0}
READY = "> aLQP\\r\n< \\x061\\r\\n\n> aYQP\\r\n< \\x060\\r\\n\n"


def test_a_transcript_from_connecting_to_a_stroke(play: Play) -> None:
    device = HamiltonMl600(play("hamilton_ml600"), CONFIG)
    device.connect()
    assert device.is_initialized() is False
    assert device.initialize().moved_ul is None
    assert device.is_initialized() is True
    assert device.select_port(2).evidence == {"port_index": 2}
    report = device.aspirate(400.0, 500.0)
    assert report.moved_ul == 400.0
    assert report.evidence["steps_after"] == 19_200


def test_a_rate_between_two_whole_seconds_is_never_exceeded(play: Play) -> None:
    text = READY + "> aM19200S3R\\r\n< \\x06\\r\\n\n> aT1\\r\n< \\x06\\x7f\\r\\n\n"
    text += "> aZ\\r\n< \\x06N\\r\\n\n> aG\\r\n< \\x06N\\r\\n\n> aYQP\\r\n< \\x0619200\\r\\n\n"
    report = HamiltonMl600(play(text=text), CONFIG).aspirate(400.0, 450.0)
    assert report.evidence["rate_ul_s"] == pytest.approx(333.333, abs=0.001)


def test_a_chain_without_addresses_is_given_them(play: Play) -> None:
    text = "> aU\\r\n> 1a\\r\n< 1b\\r\\n\n> aU\\r\n< \\x06NV01.02.A\\r\\n\n"
    HamiltonMl600(play(text=text), CONFIG).connect()


def test_a_command_that_is_not_taken_has_no_effect(play: Play) -> None:
    text = READY + "> aM19200S2R\\r\n< \\x15\\r\\n\n"
    with pytest.raises(RejectedError) as caught:
        HamiltonMl600(play(text=text), CONFIG).aspirate(400.0, 500.0)
    assert caught.value.effect is Effect.NONE


@pytest.mark.parametrize("answer", ["Y", "*"])
def test_a_syringe_error_after_a_stroke_is_in_doubt(play: Play, answer: str) -> None:
    text = READY + "> aM19200S2R\\r\n< \\x06\\r\\n\n> aT1\\r\n< \\x06\\x7f\\r\\n\n"
    text += f"> aZ\\r\n< \\x06{answer}\\r\\n\n"
    with pytest.raises(DeviceError, match="syringe error") as caught:
        HamiltonMl600(play(text=text), CONFIG).aspirate(400.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_the_right_syringe_of_two_has_its_own_bits_and_its_own_letter(play: Play) -> None:
    text = "> aCLP02R\\r\n< \\x06\\r\\n\n> aT1\\r\n< \\x06w\\r\\n\n> aT1\\r\n< \\x06\\x7f\\r\\n\n"
    text = text.replace("\\x06w", "\\x06{")
    text += "> aCZ\\r\n< \\x06N\\r\\n\n> aCG\\r\n< \\x06N\\r\\n\n> aCLQP\\r\n< \\x062\\r\\n\n"
    device = HamiltonMl600(play(text=text), {**CONFIG, "side": "C"})
    assert device.select_port(2).evidence == {"port_index": 2}


@pytest.mark.parametrize("rate_ul_s", [0.2, 501.0])
def test_a_stroke_faster_than_two_or_slower_than_3692_seconds_is_refused(
    play: Play, rate_ul_s: float
) -> None:
    transport = play(text="")
    with pytest.raises(PreconditionError):
        HamiltonMl600(transport, CONFIG).aspirate(400.0, rate_ul_s)
    assert transport.sent == []


@given(st.binary(max_size=32))
def test_any_bytes_are_an_answer_or_an_error_of_ours(frame: bytes) -> None:
    try:
        decode_reply(frame)
    except (FrameError, RejectedError):
        return
