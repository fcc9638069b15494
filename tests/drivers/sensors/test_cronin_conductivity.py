"""The Chemputer's conductivity sensor, byte for byte."""

import pytest

from drivers.sensors.cronin_conductivity import CroninConductivity, decode_counts
from labweb.domain.errors import DefinitionError, FrameError
from tests.drivers.conftest import Play


def sensor(transport: object, channel: int = 1) -> CroninConductivity:
    settings = {"full_scale_us_cm": 10_230.0, "channel_index": channel}
    return CroninConductivity(transport, settings)  # type: ignore[arg-type]


def test_counts_become_a_conductivity_by_the_calibration(play: Play) -> None:
    device = sensor(play(text="> C\\n\n< 0 141 0 0\\r\\n\n"), 2)
    assert device.measure().evidence == {"conductivity_us_cm": 1410.0, "counts": 141}


def test_a_channel_that_is_not_there_is_refused(play: Play) -> None:
    with pytest.raises(DefinitionError, match="has 2"):
        sensor(play(text="> C\\n\n< 0 0\\r\\n\n"), 3).connect()


def test_full_scale_is_no_reading(play: Play) -> None:
    with pytest.raises(FrameError, match="full scale"):
        sensor(play(text="> C\\n\n< 1023 0\\r\\n\n")).conductivity_us_cm()


@pytest.mark.parametrize(
    "frame", [b"\r\n", b"1024\r\n", b"-1 0\r\n", b"1 x\r\n", b"\xb1 0\r\n", b"12"]
)
def test_other_answers_are_frame_errors(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_counts(frame)
