"""The HCS-3000 series against bytes of its published command table."""

import pytest

from drivers.processing.manson_hcs import MansonHcs, decode_digits
from labweb.domain.errors import FrameError, PreconditionError, RejectedError
from tests.drivers.conftest import Play

SET = (
    "> GETD\\r\n< 000000000\\rOK\\r\n> VOLT018\\r\n< OK\\r\n> CURR150\\r\n< OK\\r\n"
    ">* GETS\\r\n< 018150\\rOK\\r\n> SOUT0\\r\n< OK\\r\n"
)


def supply(transport: object, model: str = "HCS-3102") -> MansonHcs:
    settings = {"model": model, "max_voltage_v": 8.0, "max_current_ma": 5000.0, "settle_s": 0.0}
    return MansonHcs(transport, settings)  # type: ignore[arg-type]


def test_digits_have_no_decimal_point_and_zero_is_on(play: Play) -> None:
    text = SET + ">* GETD\\r\n< 018000651\\rOK\\r\n"
    evidence = supply(play(text=text)).supply(1.8, 1500.0).evidence
    assert evidence == {"voltage_v": 1.8, "current_ma": 650.0, "keeps": "current"}


@pytest.mark.parametrize(("volt", "milliampere"), [(1.82, 1500.0), (1.8, 1505.0)])
def test_what_lies_between_two_steps_is_refused(
    play: Play, volt: float, milliampere: float
) -> None:
    with pytest.raises(PreconditionError) as caught:
        supply(play(text="")).supply(volt, milliampere)
    assert caught.value.code == "device.resolution"


def test_the_steps_of_the_current_depend_on_the_model(play: Play) -> None:
    with pytest.raises(PreconditionError):
        supply(play(text=""), "HCS-3204").supply(1.8, 1550.0)


def test_the_other_model_is_refused(play: Play) -> None:
    with pytest.raises(RejectedError, match="HCS-3102"):
        supply(play(text="> GMOD\\r\n< HCS-3102 \\rOK\\r\n"), "HCS-3204").connect()


def test_off_is_one(play: Play) -> None:
    supply(play(text="> SOUT1\\r\n< OK\\r\n")).stop()


@pytest.mark.parametrize(
    "frame", [b"01800650\rOK\r", b"018006501OK\r", b"01800650x\rOK\r", b"\xb018006501\rOK\r"]
)
def test_other_digits_are_a_frame_error(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_digits(frame, 4, 4, 1)
