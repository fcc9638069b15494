"""The Cytomat against bytes of its published command table, and a plate that goes in and out."""

from dataclasses import replace

import pytest

from drivers.logistics.cytomat import Cytomat
from labweb.domain.errors import DeviceError, Effect, FrameError, PreconditionError, RejectedError
from tests.drivers.conformance.movers import MOVERS
from tests.drivers.conformance.placed_models import do, running
from tests.drivers.conftest import Play

CASE = next(case for case in MOVERS if case.model == "cytomat")
WITH_A_PLATE = replace(CASE, settings={"move_s": 20.0})


def ask(command: str, answer: str) -> str:
    return f"> {command}\\r\\n\n< {answer}\\r\\n\n"


FULL = ask("ch:bs", "bs 82")
EMPTY = ask("ch:bs", "bs 02")


def store(transport: object) -> Cytomat:
    return Cytomat(transport, {"slots_count": 42, "poll_s": 0.005})  # type: ignore[arg-type]


def test_a_plate_is_stored_once_the_store_is_no_longer_busy(play: Play) -> None:
    text = FULL + FULL + ask("mv:ts 003", "ok 83") + ask("ch:bs", "bs 03") + EMPTY + EMPTY
    assert store(play(text=text)).store_plate(3).evidence == {"slot_index": 3}


def test_nothing_to_store_is_refused_before_it_moves(play: Play) -> None:
    transport = play(text=EMPTY + EMPTY)
    with pytest.raises(RejectedError, match="empty") as caught:
        store(transport).store_plate(3)
    assert caught.value.effect is Effect.NONE
    assert transport.sent == [b"ch:bs\r\n"] * 2


def test_a_command_that_is_refused_has_moved_nothing(play: Play) -> None:
    text = FULL + FULL + ask("mv:ts 003", "er 05")
    with pytest.raises(RejectedError, match="no such place") as caught:
        store(play(text=text)).store_plate(3)
    assert caught.value.effect is Effect.NONE


def test_a_plate_that_got_lost_is_unknown(play: Play) -> None:
    text = FULL + FULL + ask("mv:ts 003", "ok 83") + ask("ch:bs", "bs 0A") + ask("ch:be", "be 03")
    with pytest.raises(DeviceError, match="03") as caught:
        store(play(text=text)).store_plate(3)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.UNKNOWN)


def test_a_handler_that_carries_a_plate_is_not_initialised(play: Play) -> None:
    with pytest.raises(RejectedError, match="carries"):
        store(play(text=ask("ch:bs", "bs 90"))).initialize()


def test_a_place_that_it_has_not_is_refused(play: Play) -> None:
    with pytest.raises(PreconditionError):
        store(play(text="")).store_plate(43)


@pytest.mark.parametrize("answer", ["it +37.0", "it 37.0 36.9", "bs 80", "it +37.0 +36,9"])
def test_a_garbled_temperature_is_a_frame_error(play: Play, answer: str) -> None:
    with pytest.raises(FrameError):
        store(play(text=ask("ch:it", answer))).temperature_c()


def test_a_plate_goes_in_and_comes_out_again() -> None:
    with running([WITH_A_PLATE]) as bench, bench.connected(CASE) as device:
        do(device, ("initialize", {}))
        do(device, ("store_plate", {"slot_index": 7}))
        assert bench.state(CASE)["plates"] == ["7"]
        with pytest.raises(RejectedError):
            do(device, ("store_plate", {"slot_index": 8}))
        do(device, ("retrieve_plate", {"slot_index": 7}))
        assert bench.state(CASE)["plates"] == ["transfer"]
        assert len(bench.acts(CASE, "plate")) == 2
