"""The Chemputer pump against messages of its published command table."""

from __future__ import annotations

import pytest

from drivers.base import DeviceStoppedError
from drivers.connectors import _motion
from drivers.connectors.chemputer_pump import ChemputerPump
from drivers.transports.base import Direction
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.conftest import Play

CONFIG = {"syringe_ul": 1000.0, "max_rate_ul_s": 1000.0, "home_rate_ul_s": 500.0}
HOME = "> hard_home 30000\\x00\n< RESPOND: hard_home SUCCESS\\x00\n< RESPOND: hard_home DONE\\x00\n"
MOVE = "> move_abs 400 30000\\x00\n"
ACCEPTED = "< RESPOND: move_abs SUCCESS\\x00\n"


def homed(play: Play, text: str) -> ChemputerPump:
    device = ChemputerPump(play(text=HOME + text), CONFIG)
    device.initialize()
    return device


def test_a_transcript_from_connecting_to_a_stroke(play: Play) -> None:
    device = ChemputerPump(play("chemputer_pump"), CONFIG)
    device.connect()
    assert device.is_initialized() is False
    device.initialize()
    assert device.aspirate(400.0, 500.0).moved_ul == 400.0
    assert device.volume_ul() == 400.0


def test_errors_that_a_start_leaves_are_cleared_and_others_refused(play: Play) -> None:
    text = "> read_config\\x00\n< PUMP_CFG 0\\x00\n> read_errors\\x00\n< ERRORS: 36\\x00\n"
    text += "> clear_errors\\x00\n< RESPOND: clear_errors SUCCESS\\x00\n"
    text += "> read_errors\\x00\n< ERRORS: {}\\x00\n"
    ChemputerPump(play(text=text.format(0)), CONFIG).connect()
    with pytest.raises(RejectedError, match="errors 8 stay"):
        ChemputerPump(play(text=text.format(8)), CONFIG).connect()


def test_a_valve_is_no_pump(play: Play) -> None:
    with pytest.raises(RejectedError, match="no pump"):
        ChemputerPump(play(text="> read_config\\x00\n< VALVE_CFG 0\\x00\n"), CONFIG).connect()


@pytest.mark.parametrize(
    ("answer", "error", "effect"),
    [
        ("< RESPOND: move_abs FAILURE\\x00\n", RejectedError, Effect.NONE),
        (ACCEPTED + "< RESPOND: Stall\\x00\n", DeviceError, Effect.UNKNOWN),
        (ACCEPTED + "< RESPOND: move_abs FAILURE\\x00\n", DeviceError, Effect.UNKNOWN),
        (ACCEPTED + "< RESPOND: move_abs D\\xcfNE DONE\\x00\n", FrameError, Effect.UNKNOWN),
    ],
)
def test_what_becomes_of_a_move_and_of_the_plungers_place(
    play: Play, answer: str, error: type[DeviceError], effect: Effect
) -> None:
    device = homed(play, MOVE + answer)
    with pytest.raises(error) as caught:
        device.aspirate(400.0, 500.0)
    assert caught.value.effect is effect
    assert device.is_initialized() is (effect is Effect.NONE)


def test_a_move_whose_end_never_comes_is_in_doubt(
    play: Play, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_motion, "SLACK_S", 0.0)
    device = homed(play, MOVE + ACCEPTED)
    with pytest.raises(DeviceTimeoutError) as caught:
        device.aspirate(400.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN
    assert device.volume_ul() is None


def test_a_stop_in_mid_move_says_that_it_cannot_and_counts_the_whole_move(play: Play) -> None:
    device = homed(play, MOVE + ACCEPTED + "< RESPOND: move_abs DONE\\x00\n")
    failures: list[str] = []

    def stop(direction: Direction, data: bytes) -> None:
        if direction == "out" and data.startswith(b"move_abs"):
            with pytest.raises(DeviceError) as caught:
                device.stop()
            failures.append(caught.value.code)

    device.transport.observer = stop
    with pytest.raises(DeviceStoppedError) as caught:
        device.aspirate(400.0, 500.0)
    assert failures == ["device.cannot_stop"]
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context == {"moved_ul": 400}
    assert device.volume_ul() == 400.0


def test_no_stroke_is_made_before_the_plungers_place_is_known(play: Play) -> None:
    with pytest.raises(PreconditionError) as caught:
        ChemputerPump(play(text=""), CONFIG).aspirate(400.0, 500.0)
    assert caught.value.code == "device.not_initialized"
