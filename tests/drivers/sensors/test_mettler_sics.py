"""The balance against bytes of its published command table."""

from __future__ import annotations

import pytest

from drivers.base import DeviceStoppedError
from drivers.sensors.mettler_sics import MettlerSics, decode_weight
from drivers.transports.replay import ReplayTransport
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.conftest import Play


def balance(transport: ReplayTransport, **config: object) -> MettlerSics:
    return MettlerSics(transport, {"poll_s": 0.005, **config})


def test_weighing_waits_for_a_steady_reading_and_taring_sets_zero(play: Play) -> None:
    device = balance(play("sics_weigh"), serial_number="B021002593")
    device.connect()
    assert device.weigh().evidence == {"mass_mg": 100_001.2}
    assert device.tare().evidence == {"tare_mg": 100_001.2}
    assert device.mass_mg() == 0.0


def test_another_balance_than_the_one_set_is_refused(play: Play) -> None:
    device = balance(play(text='> I4\\r\\n\n< I4 A "X1"\\r\\n\n'), serial_number="B021002593")
    with pytest.raises(RejectedError):
        device.connect()


def test_a_reading_that_never_settles_times_out_without_effect(play: Play) -> None:
    device = balance(play(text=">* SI\\r\\n\n< S D 1.0 g\\r\\n\n"), stable_limit_s=0.1)
    with pytest.raises(DeviceTimeoutError) as caught:
        device.weigh()
    assert caught.value.effect is Effect.NONE
    assert caught.value.context == {"mass_mg": 1000.0}


def test_a_stop_ends_the_wait_for_a_steady_reading(play: Play) -> None:
    transport = play(text=">* SI\\r\\n\n< S D 1.0 g\\r\\n\n")
    device = balance(transport)
    transport.observer = lambda direction, data: device.stop()
    with pytest.raises(DeviceStoppedError) as caught:
        device.weigh()
    assert caught.value.effect is Effect.NONE


@pytest.mark.parametrize("answer", ["S S 1.5 g", "SI S 1.5 g", "SI S     1.5 g"])
def test_a_balance_may_repeat_the_command_in_its_answer(play: Play, answer: str) -> None:
    device = balance(play(text=f">* SI\\r\\n\n< {answer}\\r\\n\n"))
    assert device.weigh().evidence == {"mass_mg": 1500.0}


def test_a_silent_tare_is_unknown(play: Play) -> None:
    device = balance(play(text="> SI\\r\\n\n< S S 1.0 g\\r\\n\n> T\\r\\n\n"))
    with pytest.raises(DeviceTimeoutError) as caught:
        device.tare()
    assert caught.value.effect is Effect.UNKNOWN


@pytest.mark.parametrize("answer", ["S I", "S +", "S -", "S L", "ES", "EL", "ET", "SI I"])
def test_a_refusal_is_told_as_one(play: Play, answer: str) -> None:
    device = balance(play(text=f"> SI\\r\\n\n< {answer}\\r\\n\n"))
    with pytest.raises(RejectedError) as caught:
        device.mass_mg()
    assert caught.value.effect is Effect.NONE


def test_a_fault_of_the_balance_is_told(play: Play) -> None:
    device = balance(play(text="> SI\\r\\n\n< S S Error 10b\\r\\n\n"))
    with pytest.raises(DeviceError, match="Error 10b"):
        device.mass_mg()


@pytest.mark.parametrize(
    ("frame", "mass_mg"),
    [
        (b"S S     100.0012 g\r\n", 100_001.2),
        (b"S D      -0.5 mg\r\n", -0.5),
        (b"S S       1.5 kg\r\n", 1_500_000.0),
    ],
)
def test_a_weight_is_told_in_milligrams(frame: bytes, mass_mg: float) -> None:
    assert decode_weight(frame, "S").mass_mg == mass_mg


@pytest.mark.parametrize(
    "frame", [b"S S 100.0 lb\r\n", b"S S\r\n", b"S X 1.0 g\r\n", b"T S 1.0 g\r\n", b"\xff\r\n"]
)
def test_anything_else_is_a_frame_error(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_weight(frame, "S")


def test_a_text_stands_on_the_display_for_a_while_and_then_the_weight_again(play: Play) -> None:
    text = '> D "Balance 2"\\r\\n\n< D A\\r\\n\n> DW\\r\\n\n< DW A\\r\\n\n'
    transport = play(text=text)
    assert balance(transport).show_itself("Balance 2", 0.01).evidence == {"text": "Balance 2"}
    assert transport.remaining == []


@pytest.mark.parametrize("text", ["", 'a"b', "a" * 21, "Wägung", "a\r\nT"])
def test_a_text_that_no_display_shows_sends_nothing(play: Play, text: str) -> None:
    transport = play(text="")
    with pytest.raises(PreconditionError):
        balance(transport).show_itself(text, 1.0)
    assert transport.sent == []


def test_a_balance_without_a_display_says_so(play: Play) -> None:
    with pytest.raises(RejectedError, match="does not know"):
        balance(play(text='> D "B"\\r\\n\n< D L\\r\\n\n')).show_itself("B", 1.0)


def test_a_stop_gives_the_display_back(play: Play) -> None:
    text = '> D "B"\\r\\n\n< D A\\r\\n\n> DW\\r\\n\n< DW A\\r\\n\n'
    transport = play(text=text)
    device = balance(transport)
    transport.observer = lambda direction, data: device.stop() if data[:1] == b"D" else None
    with pytest.raises(DeviceStoppedError) as caught:
        device.show_itself("B", 30.0)
    assert caught.value.effect is Effect.NONE
    assert transport.sent[-1] == b"DW\r\n"


def test_a_text_that_stays_on_the_display_has_moved_nothing(play: Play) -> None:
    text = '> D "B"\\r\\n\n< D A\\r\\n\n> DW\\r\\n\n'
    with pytest.raises(DeviceTimeoutError) as caught:
        balance(play(text=text)).show_itself("B", 0.01)
    assert caught.value.effect is Effect.NONE
