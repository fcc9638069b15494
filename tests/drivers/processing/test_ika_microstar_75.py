"""The Microstar 75 against bytes of its published command table."""

import time

import pytest

from drivers.processing.ika_microstar_75 import IkaMicrostar75
from labweb.domain.errors import Effect, RejectedError
from tests.drivers.conftest import Play

START = "> IN_PV_4\\r\\n\n< 0 4\\r\\n\n> START_4\\r\\n\n> OUT_SP_4 300\\r\\n\n"
REPORT = ">* IN_PV_4\\r\\n\n< 298 4\\r\\n\n> IN_PV_5\\r\\n\n< 4.5 5\\r\\n\n"


def stirrer(transport: object) -> IkaMicrostar75:
    return IkaMicrostar75(transport, {"poll_s": 0.005, "gap_s": 0.0})  # type: ignore[arg-type]


def test_the_speed_is_set_after_the_start_since_it_is_forgotten_before(play: Play) -> None:
    text = START + "> IN_SP_4\\r\\n\n< 300 4\\r\\n\n" + REPORT
    report = stirrer(play(text=text)).stir(300.0)
    assert report.evidence == {"speed_rpm": 298.0, "torque_ncm": 4.5}


def test_a_speed_that_was_forgotten_stops_the_motor(play: Play) -> None:
    text = START + "> IN_SP_4\\r\\n\n< 30 4\\r\\n\n> STOP_4\\r\\n\n" + REPORT
    with pytest.raises(RejectedError) as caught:
        stirrer(play(text=text)).stir(300.0)
    assert caught.value.effect is Effect.PARTIAL


def test_commands_are_kept_apart(play: Play) -> None:
    device = IkaMicrostar75(
        play(text="> IN_PV_4\\r\\n\n< 0 4\\r\\n\n> STOP_4\\r\\n"), {"gap_s": 0.1}
    )
    started_s = time.monotonic()
    device.speed_rpm()
    device.halt()
    assert time.monotonic() - started_s >= 0.1
