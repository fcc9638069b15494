"""What the ChinWe separator says of its drain where nobody can know whether it is closed."""

from __future__ import annotations

import threading
from contextlib import suppress

import pytest

from drivers.base import DeviceStoppedError
from labweb.domain.errors import DeviceError, Effect, RejectedError
from tests.drivers.chinwe import (
    A_QUARTER,
    AT_ZERO,
    CLOSES,
    ETHER,
    HALFWAY,
    LET_GO,
    NOT_MET,
    OPENS,
    READY,
    SHUT,
    STANDS,
    STRUCK,
    TAKEN,
    WATER,
    ask,
    checked,
    confirmed,
    draining,
    flags,
    level,
    place,
    replayed,
    separator,
    speed,
)
from tests.drivers.conftest import Play
from tests.fixtures.running import until


def test_a_motor_that_was_silent_in_mid_drain_proves_nothing_by_its_zero(play: Play) -> None:
    text = READY + ask(OPENS, TAKEN) + ask(checked("060300010002")) + place(AT_ZERO)
    text += ask(CLOSES, TAKEN) + SHUT * 2 + speed(0) + SHUT + place(AT_ZERO)
    device = confirmed(play, text + place(A_QUARTER) * 2 + flags(), poll_s=0.005)
    with pytest.raises(DeviceError, match="nobody has seen") as caught:
        device.drain_lower_phase(1000.0, "falls")
    assert (caught.value.code, caught.value.effect) == ("device.drain_open", Effect.UNKNOWN)
    assert device.is_drain_closed() is None
    with pytest.raises(RejectedError, match="not shown to be closed"):
        device.drain_lower_phase(1000.0, "falls")
    assert device.is_drain_closed() is None  # somebody has turned it by hand


@pytest.mark.parametrize(
    "looks",
    [
        draining([WATER] * 3) + level(WATER) + place(AT_ZERO) * 2,
        draining([WATER] * 3) + level(ETHER) + place(AT_ZERO),
        draining([WATER], HALFWAY) + level(WATER) + place(AT_ZERO) * 2,
    ],
    ids=["seen at a look", "seen as it is closed", "on its way"],
)
@pytest.mark.parametrize(
    ("closes", "end"),
    [(ask(CLOSES, NOT_MET) + LET_GO, LET_GO), (ask(CLOSES, TAKEN), flags())],
    ids=["let go", "holds again"],
)
def test_a_motor_that_restarts_between_two_looks_proves_nothing_by_its_zero(
    play: Play, looks: str, closes: str, end: str
) -> None:
    text = READY + ask(OPENS, TAKEN) + looks + closes + (place(AT_ZERO) + end) * 2
    device = confirmed(play, text)
    with pytest.raises(DeviceError, match="may be open") as caught:
        device.drain_lower_phase(1000.0, "falls")
    assert (caught.value.code, caught.value.effect) == ("device.drain_open", Effect.UNKNOWN)
    assert caught.value.context["is_drain_closed"] is None
    assert device.is_drain_closed() is None


def test_a_separator_that_begins_does_not_know_whether_its_drain_is_closed(play: Play) -> None:
    closed = place(AT_ZERO) + ask(CLOSES, TAKEN) + SHUT
    text = SHUT + closed * 2 + SHUT + place(AT_ZERO) + closed.replace(SHUT, STANDS + SHUT)
    device = separator(play(text=text))
    assert device.is_drain_closed() is None
    with pytest.raises(DeviceError, match="nobody has seen") as caught:
        device.close_drain()
    assert (caught.value.code, caught.value.effect) == ("device.drain_open", Effect.UNKNOWN)
    with pytest.raises(RejectedError) as refused:
        device.stir(300.0, 1.0)
    assert (refused.value.code, refused.value.effect) == ("device.drain_open", Effect.NONE)
    with pytest.raises(DeviceError, match="nobody has seen"):
        device.stop()


def test_a_motor_that_has_let_go_is_not_moved_and_not_closed(play: Play) -> None:
    told = place(AT_ZERO) + LET_GO
    device = confirmed(play, told + (place(AT_ZERO) + ask(CLOSES, NOT_MET) + LET_GO + told) * 2)
    assert device.is_drain_closed() is None
    with pytest.raises(DeviceError):
        device.close_drain()


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (STRUCK, RejectedError),
        (flags() + ask("050a6d6b", "050ae26b"), RejectedError),
        (flags() + ask("050a6d6b", "050a026b") + place(AT_ZERO) * 2 + LET_GO, DeviceError),
    ],
    ids=["in alarm", "not taken", "does not hold"],
)
def test_what_cannot_be_confirmed_is_not_closed(
    play: Play, text: str, error: type[DeviceError]
) -> None:
    device = separator(play(text=text + SHUT))
    with pytest.raises(error):
        device.confirm_drain_closed()
    assert device.is_drain_closed() is None


def stopped_in_mid_drain(play: Play, zero_from: str) -> tuple[DeviceError, list[bytes]]:
    """Stop it; its motor tells zero from one request on. Return what came of it."""
    looks = level(WATER, mark=">?") + place(A_QUARTER, mark=">*")
    halted = ask(CLOSES, TAKEN, mark=">?") + ask("04fe98006b", "04fe026b", mark=">?")
    text = READY.replace(level(WATER), "").replace(speed(0), speed(0, mark=">?"))
    text = text.replace(flags(), "") + ask(OPENS, TAKEN) + looks + halted
    text += flags(mark=">?") + place(AT_ZERO, mark=">*")
    device = confirmed(play, text, valve_limit_s=5.0, poll_s=0.02)
    transport = replayed(device)
    caught: list[DeviceError] = []

    def act() -> None:
        with pytest.raises(DeviceError) as raised:
            device.drain_lower_phase(10_000.0, "falls")
        caught.append(raised.value)

    def observe(direction: str, data: bytes) -> None:
        if direction == "out" and data == bytes.fromhex(zero_from):
            transport.script.steps[:] = [
                one for one in transport.script.steps if bytes.fromhex(A_QUARTER) != one.reply
            ]

    thread = threading.Thread(target=act)
    thread.start()
    until(lambda: transport.sent.count(bytes.fromhex("05366b")) > 12)
    transport.observer, seen = observe, len(transport.sent)
    with suppress(DeviceError):
        device.stop()
    thread.join(5)
    return caught[0], transport.sent[seen:]


def test_a_stop_closes_the_drain_first_and_claims_no_volume(play: Play) -> None:
    error, sent = stopped_in_mid_drain(play, zero_from=CLOSES)
    acts = [one for one in sent if one[1] in {0xFD, 0xFE}]
    assert acts[0] == bytes.fromhex(CLOSES)
    assert bytes.fromhex("04fe98006b") in acts
    assert isinstance(error, DeviceStoppedError)
    assert error.effect is Effect.PARTIAL
    assert error.context["is_drain_closed"] is True
    assert error.context["by_time_ul"] > 0
    assert "moved_ul" not in error.context


def test_a_stop_of_a_motor_that_has_just_restarted_claims_no_closed_drain(play: Play) -> None:
    error, _ = stopped_in_mid_drain(play, zero_from="05366b")
    assert (error.code, error.effect) == ("device.drain_open", Effect.UNKNOWN)
    assert error.context["is_drain_closed"] is None
