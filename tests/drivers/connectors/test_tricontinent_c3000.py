"""The C3000 pump and valve against bytes of its published command table."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.base import DeviceStoppedError
from drivers.connectors import _motion as module
from drivers.connectors._dt import decode_reply, encode_command
from drivers.connectors.tricontinent_c3000 import TricontinentC3000
from drivers.transports.base import Direction
from drivers.transports.replay import RecordedExchange, ReplayTransport
from labweb.domain.errors import (
    DefinitionError,
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
    UnreachableError,
)
from tests.drivers.conftest import Play

KNOWN = "> /1?19\\r\n< /0`1\\x03\\r\\n\n"
READY = "> /1?6\\r\n< /0`2\\x03\\r\\n\n> /1?\\r\n< /0`{steps}\\x03\\r\\n\n"


def pump(transport: ReplayTransport, **config: object) -> TricontinentC3000:
    return TricontinentC3000(transport, {"syringe_ul": 5000.0, **config})


def ready(steps: int = 0) -> str:
    """Answer the two questions before a stroke."""
    return READY.format(steps=steps)


def test_connecting_asks_status_flag_and_firmware_and_moves_nothing(play: Play) -> None:
    transport = play("c3000_connect")
    pump(transport).connect()
    assert transport.sent == [b"/1Q\r", b"/1?19\r", b"/1?23\r"]


def test_connecting_refuses_other_firmware_than_the_one_set(play: Play) -> None:
    device = pump(play("c3000_connect"), firmware="SY-03B")
    with pytest.raises(RejectedError) as caught:
        device.connect()
    assert caught.value.effect is Effect.NONE


def test_initializing_waits_until_idle_and_proves_the_zero(play: Play) -> None:
    report = pump(play("c3000_initialize")).initialize()
    assert report.moved_ul is None
    assert report.evidence == {"steps_before": None, "steps_after": 0}


def test_an_aspiration_is_an_absolute_move_from_where_the_plunger_stands(play: Play) -> None:
    transport = play("c3000_aspirate")
    report = pump(transport).aspirate(1000.0, 500.0)
    assert transport.sent[2] == b"/1V300A900R\r"
    assert report.moved_ul == 1000.0
    assert report.evidence == {"steps_before": 300, "steps_after": 900, "port_index": 2}


def test_a_dispense_reports_a_positive_volume(play: Play) -> None:
    report = pump(play("c3000_dispense")).dispense(1000.0, 500.0)
    assert report.moved_ul == 1000.0
    assert report.evidence["port_index"] == 5


def test_the_valve_turns_and_says_where_it_stands(play: Play) -> None:
    assert pump(play("c3000_select_port")).select_port(4).evidence == {"port_index": 4}


def test_a_stop_in_mid_stroke_is_partial_with_the_volume_that_moved(play: Play) -> None:
    transport = play("c3000_stopped")
    device = pump(transport)
    is_running, stoppers = threading.Event(), []

    def watch(direction: Direction, data: bytes) -> None:
        if direction == "out" and data == b"/1Q\r":
            is_running.set()
        if direction == "out" and data == b"/1TR\r":
            # From here on the pump stands still at step 450.
            script = transport.script
            script.steps = [
                replace(one, reply=b"/0`\x03\r\n") if one.request == b"/1Q\r" else one
                for one in script.steps
            ]
            for request, reply in ((b"/1?\r", b"/0`450\x03\r\n"), (b"/1?19\r", b"/0`1\x03\r\n")):
                script.anytime[request] = RecordedExchange(">?", request, reply)

    def stop() -> None:
        is_running.wait(5)
        device.stop()

    transport.observer = watch
    stoppers.append(threading.Thread(target=stop))
    stoppers[0].start()
    with pytest.raises(DeviceStoppedError) as caught:
        device.aspirate(1000.0, 500.0)
    stoppers[0].join(5)
    assert b"/1TR\r" in transport.sent
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context == {"moved_ul": 750.0, "steps_before": 0, "steps_after": 450}


def test_after_a_stop_nothing_starts_until_it_is_cleared(play: Play) -> None:
    transport = play(text="> /1TR\\r\n< /0`\\x03\\r\\n\n")
    device = pump(transport)
    device.stop()
    for act in (
        device.initialize,
        lambda: device.select_port(1),
        lambda: device.aspirate(1000.0, 500.0),
    ):
        with pytest.raises(DeviceStoppedError) as caught:
            act()
        assert caught.value.effect is Effect.NONE
    assert transport.sent == [b"/1TR\r"]
    device.clear_stop()
    assert not device.is_stopped


def test_a_refused_move_has_no_effect(play: Play) -> None:
    device = pump(play(text=ready() + "> /1V300A600R\\r\n< /0g\\x03\\r\\n\n"))
    with pytest.raises(RejectedError, match="not initialised") as caught:
        device.aspirate(1000.0, 500.0)
    assert caught.value.effect is Effect.NONE


def test_silence_before_the_stroke_has_no_effect(play: Play) -> None:
    device = pump(play(text="> /1?6\\r\n"))
    with pytest.raises(DeviceTimeoutError) as caught:
        device.aspirate(1000.0, 500.0)
    assert caught.value.effect is Effect.NONE


def test_silence_after_the_acting_command_is_unknown(play: Play) -> None:
    device = pump(play(text=ready() + "> /1V300A600R\\r\n"))
    with pytest.raises(DeviceTimeoutError) as caught:
        device.aspirate(1000.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_a_garbled_answer_to_the_acting_command_is_unknown(play: Play) -> None:
    device = pump(play(text=ready() + "> /1V300A600R\\r\n< /\\xff\\x00\\x03\\r\\n\n"))
    with pytest.raises(FrameError) as caught:
        device.aspirate(1000.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_a_line_that_breaks_while_the_plunger_moves_is_unknown(play: Play) -> None:
    transport = play(text=ready() + "> /1V300A600R\\r\n< /0@\\x03\\r\\n\n")

    def cut(direction: Direction, data: bytes) -> None:
        if data == b"/1Q\r":
            raise UnreachableError("cable pulled", effect=Effect.NONE)

    transport.observer = cut
    with pytest.raises(UnreachableError) as caught:
        pump(transport).aspirate(1000.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_a_stop_between_the_check_and_the_command_still_halts_the_stroke(play: Play) -> None:
    text = (
        ready()
        + "> /1V300A600R\\r\n< /0@\\x03\\r\\n\n"
        + "> /1TR\\r\n< /0`\\x03\\r\\n\n> /1Q\\r\n< /0`\\x03\\r\\n\n"
        + KNOWN
        + "> /1?\\r\n< /0`6\\x03\\r\\n\n"
    )
    transport = play(text=text)
    device = pump(transport)

    def stop_late(direction: Direction, data: bytes) -> None:
        if direction == "out" and data == b"/1V300A600R\r":
            device._stopping.set()

    transport.observer = stop_late
    with pytest.raises(DeviceStoppedError) as caught:
        device.aspirate(1000.0, 500.0)
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["moved_ul"] == 10.0


def test_an_overload_while_moving_is_unknown(play: Play) -> None:
    text = ready() + "> /1V300A600R\\r\n< /0@\\x03\\r\\n\n> /1Q\\r\n< /0i\\x03\\r\\n\n"
    with pytest.raises(DeviceError, match="plunger overload") as caught:
        pump(play(text=text)).aspirate(1000.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_a_plunger_that_stops_short_is_partial(play: Play) -> None:
    text = (
        ready()
        + "> /1V300A600R\\r\n< /0@\\x03\\r\\n\n> /1Q\\r\n< /0`\\x03\\r\\n\n"
        + "> /1?\\r\n< /0`599\\x03\\r\\n\n"
        + KNOWN
        + "> /1?\\r\n< /0`599\\x03\\r\\n\n"
    )
    with pytest.raises(DeviceError) as caught:
        pump(play(text=text)).aspirate(1000.0, 500.0)
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["moved_ul"] == pytest.approx(998.333)


def test_a_plunger_that_lost_its_zero_on_the_way_is_unknown(play: Play) -> None:
    text = (
        ready()
        + "> /1V300A600R\\r\n< /0@\\x03\\r\\n\n> /1Q\\r\n< /0`\\x03\\r\\n\n"
        + "> /1?\\r\n< /0`0\\x03\\r\\n\n> /1?19\\r\n< /0`0\\x03\\r\\n\n"
    )
    with pytest.raises(DeviceError) as caught:
        pump(play(text=text)).aspirate(1000.0, 500.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_a_pump_that_stays_busy_is_halted_and_told_how_far_it_came(
    play: Play, monkeypatch: pytest.MonkeyPatch
) -> None:
    # 600 steps at 300 steps/s may take 3 s: leave a tenth of a second.
    monkeypatch.setattr(module, "SLACK_S", -2.9)
    text = (
        ready()
        + "> /1V300A600R\\r\n< /0@\\x03\\r\\n\n>* /1Q\\r\n< /0@\\x03\\r\\n\n"
        + "> /1TR\\r\n< /0`\\x03\\r\\n\n> /1Q\\r\n< /0`\\x03\\r\\n\n"
        + KNOWN
        + "> /1?\\r\n< /0`300\\x03\\r\\n\n"
    )
    with pytest.raises(DeviceError) as caught:
        pump(play(text=text)).aspirate(1000.0, 500.0)
    assert caught.value.code == "device.slow"
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["moved_ul"] == 500.0


def test_a_motion_that_ended_while_nobody_could_look_is_not_called_slow(
    play: Play, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The host was halted for longer than the motion may take, between two looks.
    monkeypatch.setattr(module, "SLACK_S", -2.9)
    monkeypatch.setattr(module, "POLL_S", 0.2)
    text = (
        ready()
        + "> /1V300A600R\\r\n< /0@\\x03\\r\\n\n> /1Q\\r\n< /0@\\x03\\r\\n\n"
        + "> /1Q\\r\n< /0`\\x03\\r\\n\n> /1?\\r\n< /0`600\\x03\\r\\n\n"
    )
    assert pump(play(text=text)).aspirate(1000.0, 500.0).moved_ul == 1000.0


@pytest.mark.parametrize(
    ("volume_ul", "rate_ul_s", "code"),
    [
        (5001.0, 500.0, "device.stroke_out_of_range"),
        (0.5, 500.0, "device.volume_too_small"),
    ],
)
def test_a_stroke_beyond_the_syringe_is_refused_before_it_is_sent(
    play: Play, volume_ul: float, rate_ul_s: float, code: str
) -> None:
    with pytest.raises(PreconditionError) as caught:
        pump(play(text="")).aspirate(volume_ul, rate_ul_s)
    assert caught.value.code == code


def test_a_stroke_beyond_the_end_of_travel_is_refused_before_it_is_sent(play: Play) -> None:
    with pytest.raises(PreconditionError) as caught:
        pump(play(text=ready(2900))).aspirate(1000.0, 500.0)
    assert caught.value.code == "device.stroke_out_of_range"


@pytest.mark.parametrize("rate_ul_s", [0.1, 20_000.0, 1001.0])
def test_a_rate_the_pump_cannot_do_is_refused(play: Play, rate_ul_s: float) -> None:
    device = pump(play(text=""), max_rate_ul_s=1000.0)
    with pytest.raises(PreconditionError) as caught:
        device.dispense(1000.0, rate_ul_s)
    assert caught.value.code == "device.rate_out_of_range"


def test_a_port_the_valve_does_not_have_is_refused(play: Play) -> None:
    with pytest.raises(PreconditionError):
        pump(play(text="")).select_port(7)


def test_a_valve_that_stands_elsewhere_is_partial_and_moved_no_liquid(play: Play) -> None:
    text = (
        "> /1I4R\\r\n< /0@\\x03\\r\\n\n> /1Q\\r\n< /0`\\x03\\r\\n\n> /1?6\\r\n< /0`3\\x03\\r\\n\n"
    )
    with pytest.raises(DeviceError) as caught:
        pump(play(text=text)).select_port(4)
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context == {"moved_ul": 0.0, "port_index": 3}


def test_initializing_through_a_chosen_port_names_it(play: Play) -> None:
    transport = play(text="> /1?19\\r\n< /0`0\\x03\\r\\n\n> /1Z0,2,6R\\r\n")
    device = pump(transport, init_input_port_index=2, init_output_port_index=6)
    with pytest.raises(DeviceTimeoutError):
        device.initialize()


@pytest.mark.parametrize(
    "config",
    [
        {"syringe_ul": 0.0},
        {"address": "0"},
        {"colour": "red"},
        {"init_input_port_index": 1},
        {"max_rate_ul_s": 1e9},
        {"steps_full_count": 24_000},
    ],
)
def test_bad_settings_are_refused(play: Play, config: dict[str, Any]) -> None:
    with pytest.raises(DefinitionError):
        TricontinentC3000(play(text=""), {"syringe_ul": 5000.0, **config})


def test_a_frame_is_address_commands_and_run() -> None:
    assert encode_command(":", "I3") == b"/:I3R\r"


@given(st.binary(max_size=64))
def test_any_bytes_are_an_answer_or_a_frame_error(frame: bytes) -> None:
    try:
        reply = decode_reply(frame)
    except FrameError:
        return
    assert 0 <= reply.error_code <= 15
