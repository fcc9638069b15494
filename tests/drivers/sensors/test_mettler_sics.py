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
