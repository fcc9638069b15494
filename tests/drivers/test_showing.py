"""Devices that show which one they are: on their simulated instruments, and by published frames.

The frames of the arm are those of the maker's table of dashboard commands, those of the cycler
of its interface: `popup`, `close popup`, `light`.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest

from drivers.base import DeviceStoppedError
from drivers.characterization.neware_bts import NewareBts, encode_command
from drivers.logistics.ur_dashboard import UrDashboard
from drivers.transports.replay import RecordedExchange, ReplayTransport
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError
from tests.drivers.conformance.analysers import CYCLERS, LIQUID_HANDLERS
from tests.drivers.conformance.movers import MOVERS
from tests.drivers.conformance.placed_models import Bench, Case, running
from tests.drivers.conftest import Play
from tests.fixtures.running import until

ARM = next(case for case in MOVERS if case.model == "ur_dashboard")
(ROBOT,), (CYCLER,) = LIQUID_HANDLERS, CYCLERS
CASES = [ARM, ROBOT, CYCLER]
QUICK: dict[str, Any] = {"text": "Bench 2", "shown_s": 0.01}


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(CASES) as started:
        yield started


def shown(bench: Bench, case: Case) -> Any:  # noqa: ANN401 - a text or whether it is lit
    """Return what a person in front of the instrument sees of it."""
    state = bench.state(case)
    match case.model:
        case "ur_dashboard":
            return state["popup"]
        case "opentrons_ot2":
            return state["blinks"]
        case _:
            return state["21-1-1"]["is_lit"]


@contextmanager
def showing(device: Any, shown_s: float) -> Iterator[None]:  # noqa: ANN401 - any driver
    """Let a device show itself on a thread of its own, until it is over or stopped."""

    def show() -> None:
        with suppress(DeviceStoppedError):
            device.show_itself("Bench 2", shown_s)

    thread = threading.Thread(target=show)
    thread.start()
    try:
        yield
    finally:
        thread.join()


@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case.model))
def test_the_instrument_shows_it_for_a_while_and_nothing_else_happens(
    bench: Bench, case: Case
) -> None:
    acts = len(bench.acts(case))
    with bench.connected(case) as device:
        assert not shown(bench, case)
        # The robot counts the seconds of its own clock, which is faster here.
        with showing(device, 30.0 if case is ROBOT else 1.0):
            until(lambda: bool(shown(bench, case)))
            if case is ARM:
                assert shown(bench, case) == "Bench 2"
            if case is ROBOT:
                device.stop()
        until(lambda: not shown(bench, case))
        device.clear_stop()
    assert len(bench.acts(case)) == acts


def ask(command: str, answer: str) -> str:
    return f"> {command}\\n\n< {answer}\\n\n"


AT_REST = ask("running", "Program running: false") + ask("programState", "STOPPED pick.urp")


def arm(transport: object) -> UrDashboard:
    return UrDashboard(transport, {"programs": []})  # type: ignore[arg-type]


def test_a_popup_is_shown_and_closed(play: Play) -> None:
    text = AT_REST + ask("popup Bench 2", "showing popup") + ask("close popup", "closing popup")
    assert arm(play(text=text)).show_itself(**QUICK).evidence == {"text": "Bench 2"}


@pytest.mark.parametrize(
    "under_way",
    [
        ask("running", "Program running: true"),
        ask("running", "Program running: false") + ask("programState", "PAUSED pick.urp"),
    ],
)
def test_a_program_under_way_keeps_its_own_popups(play: Play, under_way: str) -> None:
    transport = play(text=under_way)
    with pytest.raises(RejectedError) as refusal:
        arm(transport).show_itself(**QUICK)
    assert refusal.value.effect is Effect.NONE
    assert not any(b"popup" in frame for frame in transport.sent)


def test_a_popup_that_is_not_understood_has_moved_nothing(play: Play) -> None:
    refused = ask("popup Bench 2", "could not understand: popup")
    with pytest.raises(FrameError) as caught:
        arm(play(text=AT_REST + refused)).show_itself(**QUICK)
    assert caught.value.effect is Effect.NONE


def test_a_stop_closes_the_popup(play: Play) -> None:
    text = AT_REST + ask("popup Bench 2", "showing popup") + ask("close popup", "closing popup")
    transport = play(text=text)
    device = arm(transport)
    threading.Timer(0.2, device._stopping.set).start()
    with pytest.raises(DeviceStoppedError) as caught:
        device.show_itself("Bench 2", 30.0)
    assert caught.value.effect is Effect.NONE
    assert transport.sent[-1] == b"close popup\n"


PLACE = 'ip="127.0.0.1" devtype="27" devid="21" subdevid="1" chlid="1"'


def light(inner: str, answer: str) -> RecordedExchange:
    sent = encode_command("light", f'<list count="1"><light {PLACE}>{inner}</light></list>')
    body = f'<list count="1"><light {PLACE}>{answer}</light></list>'
    return RecordedExchange(">", sent, encode_command("light_resp", body))


@contextmanager
def cycler(*exchanges: RecordedExchange) -> Iterator[NewareBts]:
    transport = ReplayTransport(list(exchanges), line="replay:lamp")
    transport.open()
    settings = {"device_index": 21, "subdevice_index": 1, "channel_index": 1}
    device = NewareBts(transport, settings)
    transport.acquire(device)
    try:
        yield device
    finally:
        device.close()
        transport.close()


def test_the_lamp_of_the_channel_is_lit_and_put_out() -> None:
    with cycler(light("true", "ok"), light("false", "ok")) as device:
        told = device.show_itself(**QUICK)
    assert told.evidence == {"lit_s": 0.01, "text_left_out": "Bench 2"}


def test_a_lamp_that_is_refused_has_moved_nothing() -> None:
    with (
        cycler(light("true", "false")) as device,
        pytest.raises(DeviceError) as caught,
    ):
        device.show_itself(**QUICK)
    assert caught.value.effect is Effect.NONE


def test_the_robot_is_asked_to_blink_in_whole_seconds(bench: Bench) -> None:
    sent: list[bytes] = []
    with bench.connected(ROBOT) as robot:
        device: Any = robot
        device.transport.observer = lambda way, data: sent.append(data) if way == "out" else None
        device.show_itself("Bench 2", 1.2)
    (first, *_) = b"".join(sent).splitlines()
    assert first.startswith(b"POST /identify?seconds=2 ")
