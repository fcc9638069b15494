"""The MR Hei-Connect against bytes of its published command table."""

import pytest

from drivers.processing.heidolph_hei_connect import HeidolphHeiConnect, decode_echo
from labweb.domain.errors import Effect, FrameError, RejectedError
from tests.drivers.conftest import Play

READY = "> STATUS\\r\\n\n< STATUS 1\\r\\n\n> IN_MODE_1\\r\\n\n< IN_MODE_1 1\\r\\n\n"


def plate(transport: object, **config: object) -> HeidolphHeiConnect:
    return HeidolphHeiConnect(transport, {"poll_s": 0.005, "settle_s": 0.0, "gap_s": 0.0, **config})  # type: ignore[arg-type]


def test_each_answer_repeats_its_command(play: Play) -> None:
    text = (
        READY + "> IN_PV_1\\r\\n\n< IN_PV_1 22.0\\r\\n\n"
        "> OUT_SP_1 60\\r\\n\n< OUT_SP_1 60\\r\\n\n> IN_SP_1\\r\\n\n< IN_SP_1 60.0\\r\\n\n"
        "> START_1\\r\\n\n< START_1\\r\\n\n>* IN_PV_1\\r\\n\n< IN_PV_1 59.9\\r\\n\n"
        "> IN_SP_1\\r\\n\n< IN_SP_1 60.0\\r\\n\n"
    )
    assert plate(play(text=text)).heat_to(60.0, 1.0).evidence["temperature_c"] == 59.9


def test_a_plate_that_controls_by_another_sensor_does_not_heat(play: Play) -> None:
    transport = play(text=READY)
    with pytest.raises(RejectedError, match="external") as caught:
        plate(transport, sensor="plate").heat_to(60.0, 1.0)
    assert caught.value.effect is Effect.NONE
    assert not [frame for frame in transport.sent if frame.startswith((b"OUT", b"START"))]


def test_a_blocked_plate_does_not_stir(play: Play) -> None:
    with pytest.raises(RejectedError, match="blocked"):
        plate(play(text="> STATUS\\r\\n\n< STATUS -1\\r\\n\n")).stir(300.0)


@pytest.mark.parametrize(
    "frame", [b"IN_PV_2 25.3\r\n", b"25.3\r\n", b"IN_PV_1 warm\r\n", b"\xc9N_PV_1 1\r\n"]
)
def test_an_answer_to_something_else_is_a_frame_error(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_echo(frame, "IN_PV_1")
