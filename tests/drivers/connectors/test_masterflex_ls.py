"""The Masterflex L/S against bytes of its published command table."""

from __future__ import annotations

import pytest

from drivers.connectors.masterflex_ls import MasterflexLs, encode_claim, encode_command
from labweb.domain.errors import DeviceTimeoutError, Effect, FrameError, RejectedError
from tests.drivers.conftest import Play

CONFIG = {"per_turn_ul": 800.0}


def test_a_transcript_of_a_flow(play: Play) -> None:
    device = MasterflexLs(play("masterflex_ls"), CONFIG)
    device.connect()
    assert device.start_flow(500.0).evidence["speed_rpm"] == 37.5
    assert device.is_running() is True
    assert device.rate_setpoint_ul_s() == 500.0
    device.stop_flow()
    assert device.is_running() is False


def test_the_published_frames() -> None:
    assert encode_claim(2) == b"\x05P02\r"
    assert encode_command(2, "S+100.0") == b"\x02P02S+100.0\r"


def test_the_other_sense_of_rotation_has_the_other_sign(play: Play) -> None:
    text = "> \\x02P01S-37.5\\r\n< \\x06\n> \\x02P01G0\\r\n< \\x06\n"
    MasterflexLs(play(text=text), {**CONFIG, "direction": "CCW"}).start_flow(500.0)


def test_a_delivery_runs_by_the_drives_own_turns_and_is_halted_after_it(play: Play) -> None:
    frames = ("H", "S+37.5", "Z", "V0.25", "G", "H")
    text = "".join(f"> \\x02P01{frame}\\r\n< \\x06\n" for frame in frames)
    device = MasterflexLs(play(text=text), CONFIG)
    device.stop_flow()
    report = device.deliver(200.0, 500.0)
    assert report.moved_ul == 200.0


def test_a_halt_that_is_not_taken_leaves_a_delivery_in_doubt(play: Play) -> None:
    text = "".join(
        f"> \\x02P01{frame}\\r\n< \\x06\n" for frame in ("H", "S+37.5", "Z", "V0.25", "G")
    )
    device = MasterflexLs(play(text=text + "> \\x02P01H\\r\n< \\x15\n"), CONFIG)
    device.stop_flow()
    with pytest.raises(RejectedError) as caught:
        device.deliver(200.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_whether_it_runs_is_not_known_before_it_was_told_to(play: Play) -> None:
    transport = play(text="")
    device = MasterflexLs(transport, CONFIG)
    assert device.is_running() is None
    assert device.rate_setpoint_ul_s() is None
    with pytest.raises(RejectedError, match="not known to stand") as caught:
        device.deliver(200.0, 500.0)
    assert caught.value.effect is Effect.NONE
    assert transport.sent == []


@pytest.mark.parametrize(
    ("answer", "error", "effect"),
    [
        ("< \\x15\n", RejectedError, Effect.NONE),
        ("", DeviceTimeoutError, Effect.UNKNOWN),
        ("< \\x02P01I00\\r\n", FrameError, Effect.UNKNOWN),
    ],
)
def test_what_becomes_of_a_start(
    play: Play, answer: str, error: type[Exception], effect: Effect
) -> None:
    text = "> \\x02P01S+37.5\\r\n< \\x06\n> \\x02P01G0\\r\n" + answer
    with pytest.raises(error) as caught:
        MasterflexLs(play(text=text), CONFIG).start_flow(500.0)
    assert caught.value.effect is effect  # type: ignore[attr-defined]
