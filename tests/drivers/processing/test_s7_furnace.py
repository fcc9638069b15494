"""A furnace behind the S7 server of python-snap7, whose program keeps to the table of the block."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from drivers.load import read_statuses
from drivers.processing import s7_furnace
from drivers.processing._s7_block import decode_block, encode_setpoint
from drivers.processing.s7_furnace import S7Furnace
from drivers.transports.s7 import transport as s7
from drivers.transports.s7.codes import failure_of_item, failure_of_job
from drivers.transports.s7.transport import S7Transport
from drivers.transports.urls import addresses_of, line_key, make_transport
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
    UnreachableError,
)
from tests.drivers.conformance.placed_models import Doing, a_free_port
from tests.drivers.plc import DOOR, ERROR, REMOTE, Plc
from tests.drivers.relay import Relay, relayed
from tests.fixtures.running import until

CONFIG: dict[str, Any] = {
    "max_temperature_c": 1100.0,
    "max_ramp_k_min": 10.0,
    "watchdog_s": 3600,
    "settle_s": 0.05,
    "poll_s": 0.02,
    "grace_s": 0.2,
    "reach_limit_s": 5.0,
}
UP = ("ramp_to", {"temperature_c": 500.0, "ramp_k_min": 5.0, "tolerance_c": 2.0})


@pytest.fixture(scope="module")
def running() -> Iterator[tuple[Plc, int]]:
    port = a_free_port()
    plc = Plc(port)
    try:
        yield plc, port
    finally:
        plc.close()


@pytest.fixture
def plc(running: tuple[Plc, int], monkeypatch: pytest.MonkeyPatch) -> Iterator[Plc]:
    monkeypatch.setattr(s7, "ANSWER_S", 0.4)
    monkeypatch.setattr(s7_furnace, "TAKEN_S", 1.0)
    plc, _ = running
    yield plc
    plc.block[18] = REMOTE
    plc.put(16, ">H", 0)
    plc.put(20, ">h", 0)
    plc.put(46, ">H", 1)
    plc.refuses, plc.is_deaf, plc.step_c = 0, False, 200.0
    until(lambda: plc.get(22, ">f") == 20.0)
    plc.starts.clear()


@pytest.fixture
def relay(running: tuple[Plc, int]) -> Iterator[Relay]:
    with relayed(running[1]) as relay:
        yield relay


@contextmanager
def connected(port: int, **config: object) -> Iterator[S7Furnace]:
    transport = make_transport(f"s7://127.0.0.1:{port}/0/1")
    assert isinstance(transport, S7Transport)
    furnace = S7Furnace(transport, {**CONFIG, **config})
    furnace.connect()
    try:
        yield furnace
    finally:
        furnace.close()


@pytest.fixture
def furnace(plc: Plc, relay: Relay) -> Iterator[S7Furnace]:
    before = plc.get(10, ">H")
    with connected(relay.port) as furnace:
        until(lambda: plc.get(10, ">H") != before)
        with furnace.transport.lock:  # the first count is answered
            pass
        yield furnace


def test_the_block_is_read_by_its_bytes() -> None:
    block = bytes.fromhex(
        "43fa0000 40a00000 001e 0007 01 00 0009 0008 11 00 fffe 41a40000 42c80000 42480000"
        "41a00000 44898000 000003e8 0001"
    )
    state = decode_block(block)
    assert (state.target_c, state.ramp_k_min, state.watchdog_s, state.life) == (500.0, 5.0, 30, 7)
    assert (state.commands, state.order, state.order_taken, state.bits) == (1, 9, 8, 0x11)
    assert (state.error, state.reading_c, state.working_c, state.output) == (-2, 20.5, 100.0, 50.0)
    assert (state.low_c, state.high_c, state.uptime_ms, state.version) == (20.0, 1100.0, 1000, 1)
    assert encode_setpoint(500.0, 5.0, 30) == block[:10]


@pytest.mark.parametrize("block", [b"", bytes(47), bytes(49), b"\x7f\xc0\x00\x00" + bytes(44)])
def test_a_block_that_is_none_is_a_frame_error(block: bytes) -> None:
    with pytest.raises(FrameError):
        decode_block(block)


def test_it_follows_the_ramp_and_stays_on(plc: Plc, furnace: S7Furnace) -> None:
    evidence = furnace.ramp_to(500.0, 5.0, 2.0).evidence
    assert evidence == {
        "temperature_c": 500.0,
        "temperature_setpoint_c": 500.0,
        "is_heating": True,
    }
    assert plc.starts == [(500.0, 5.0)]
    assert (plc.get(8, ">H"), plc.get(16, ">H")) == (3600, 1)
    assert read_statuses(furnace) == {
        "temperature_c": 500.0,
        "temperature_setpoint_c": 500.0,
        "is_heating": True,
        "is_door_open": False,
    }
    assert furnace.hold(0.1, 500.0, 2.0).evidence["held_s"] >= 0.1
    assert furnace.stop_heating().evidence["is_heating"] is False
    assert not plc.is_on


def test_a_stop_turns_the_heater_off_and_says_how_far_it_came(plc: Plc, furnace: S7Furnace) -> None:
    plc.step_c = 0.5
    doing = Doing(furnace, UP)
    until(lambda: plc.is_on)
    furnace.stop()
    error = doing.failure()
    assert (error.code, error.effect) == ("device.stopped", Effect.PARTIAL)
    assert 20.0 <= error.context["temperature_c"] < 500.0
    assert not plc.is_on


def test_an_order_number_that_stood_there_is_never_taken_for_a_start(
    plc: Plc, furnace: S7Furnace
) -> None:
    plc.put(14, ">H", 1)
    plc.put(16, ">H", 0xFFFF)
    furnace.ramp_to(500.0, 5.0, 2.0)
    assert plc.get(16, ">H") == 1
    assert len(plc.starts) == 1


@pytest.mark.parametrize(
    ("bits", "error", "why"),
    [
        (0, 0, "key switch"),
        (REMOTE | DOOR, 0, "close its door"),
        (REMOTE | ERROR, 2, "over-temperature"),
        (REMOTE | ERROR, 5, "the watchdog saw nobody"),
    ],
)
def test_a_furnace_that_is_not_ready_is_not_started(
    plc: Plc, furnace: S7Furnace, bits: int, error: int, why: str
) -> None:
    plc.block[18] = bits
    plc.put(20, ">h", error)
    with pytest.raises(RejectedError, match=why) as caught:
        furnace.ramp_to(500.0, 5.0, 2.0)
    assert caught.value.effect is Effect.NONE
    assert plc.get(0, ">f") != 500.0 or not plc.starts


@pytest.mark.parametrize("error", [4, 6])
def test_a_start_that_the_controller_refuses_has_no_effect(
    plc: Plc, furnace: S7Furnace, error: int
) -> None:
    plc.refuses = error
    with pytest.raises(RejectedError) as caught:
        furnace.ramp_to(500.0, 5.0, 2.0)
    assert (caught.value.effect, caught.value.context["alarm"]) == (Effect.NONE, error)
    assert plc.starts == []


@pytest.mark.parametrize(
    "act",
    [
        ("ramp_to", (1101.0, 5.0, 2.0)),
        ("ramp_to", (500.0, 11.0, 2.0)),
        ("ramp_to", (500.0, 0.0, 2.0)),
        ("hold", (1.0, 1200.0, 2.0)),
    ],
)
def test_what_is_beyond_the_lab_is_refused_before_a_byte_is_sent(
    plc: Plc, furnace: S7Furnace, act: tuple[str, tuple[float, ...]]
) -> None:
    sent: list[bytes] = []
    furnace.transport.observer = lambda way, data: sent.append(data) if way == "out" else None
    with pytest.raises(PreconditionError):
        getattr(furnace, act[0])(*act[1])
    assert sent == []
    assert plc.starts == []


def test_what_is_beyond_the_furnace_is_refused(plc: Plc, relay: Relay) -> None:
    plc.put(34, ">ff", 20.0, 400.0)
    try:
        with connected(relay.port) as furnace, pytest.raises(PreconditionError, match="20 to 400"):
            furnace.ramp_to(500.0, 5.0, 2.0)
    finally:
        plc.put(34, ">ff", 20.0, 1100.0)
    assert plc.starts == []


@pytest.mark.parametrize("error", [1, 2, 3, 5])
def test_an_alarm_on_the_way_ends_the_action(plc: Plc, furnace: S7Furnace, error: int) -> None:
    plc.step_c = 0.5
    doing = Doing(furnace, UP)
    until(lambda: plc.is_on)
    plc.fail(error)
    failed = doing.failure()
    assert failed.code == "device.alarm"
    assert failed.context["alarm"] == error
    assert failed.effect is (Effect.UNKNOWN if error == 1 else Effect.PARTIAL)
    if error == 2:
        assert furnace.acknowledge_alarm().evidence["is_heating"] is False
        assert plc.get(20, ">h") == 0


def test_an_alarm_whose_reason_stays_is_not_acknowledged(plc: Plc, furnace: S7Furnace) -> None:
    plc.fail(2)
    plc.is_deaf = True
    with pytest.raises(DeviceError) as caught:
        furnace.acknowledge_alarm()
    assert caught.value.effect is Effect.NONE


def test_a_lost_answer_to_the_start_is_unknown_and_the_heater_is_turned_off(
    plc: Plc, furnace: S7Furnace, relay: Relay
) -> None:
    def lose_one(data: bytes) -> None:
        # function 5 writes; its address, in bits, is that of the commands; the data is start
        if data[-1:] == b"\x01" and data[17:18] == b"\x05" and data[-2:] != b"\x00\x01":
            relay.silence()
            relay.when_sent = lambda _: None
            threading.Timer(0.6, hear).start()

    def hear() -> None:
        relay.change = lambda data: data

    relay.when_sent = lose_one
    with pytest.raises(DeviceTimeoutError) as caught:
        furnace.ramp_to(500.0, 5.0, 2.0)
    assert caught.value.effect is Effect.UNKNOWN
    assert len(plc.starts) <= 1


def test_silence_in_mid_action_is_unknown_and_not_started_again(
    plc: Plc, furnace: S7Furnace, relay: Relay
) -> None:
    plc.step_c = 0.5
    doing = Doing(furnace, UP)
    until(lambda: plc.is_on)
    relay.silence()
    error = doing.failure()
    assert error.effect is Effect.UNKNOWN
    assert "not_turned_off" in error.context
    assert len(plc.starts) == 1


def test_a_late_answer_is_not_taken_for_that_of_the_next_question(
    plc: Plc, furnace: S7Furnace, relay: Relay
) -> None:
    held: list[bytes] = []

    def late(data: bytes) -> bytes:
        held.append(data)
        return b""

    relay.change = late
    with pytest.raises(DeviceTimeoutError):
        furnace.temperature_c()
    relay.change = lambda data: data
    furnace.connect()
    plc.put(0, ">f", 321.0)
    assert furnace.temperature_setpoint_c() == 321.0
    assert held


def test_a_cut_line_is_unknown_in_mid_action_and_nothing_before(
    plc: Plc, furnace: S7Furnace, relay: Relay
) -> None:
    plc.step_c = 0.5
    doing = Doing(furnace, UP)
    until(lambda: plc.is_on)
    relay.cut()
    error = doing.failure()
    assert isinstance(error, UnreachableError)
    assert error.effect is Effect.UNKNOWN
    assert not furnace.transport.is_open
    with pytest.raises(UnreachableError) as caught:
        furnace.ramp_to(500.0, 5.0, 2.0)
    assert caught.value.effect is Effect.NONE


@pytest.mark.parametrize(
    "garble",
    [
        lambda data: data[:21] + b"\x42" + data[22:],
        lambda data: b"\x04" + data[1:],
        lambda data: data[:7] + b"\x33" + data[8:],
        lambda data: data[:20],
    ],
)
def test_a_garbled_frame_is_never_a_value_and_the_line_is_sound_again(
    plc: Plc,
    furnace: S7Furnace,
    relay: Relay,
    garble: Any,  # noqa: ANN401 - a lambda
) -> None:
    def once(data: bytes) -> bytes:
        relay.change = lambda data: data
        return bytes(garble(data))

    relay.change = once
    with pytest.raises(DeviceError) as caught:
        furnace.temperature_c()
    assert caught.value.effect is Effect.UNKNOWN
    furnace.connect()
    assert furnace.temperature_c() == plc.get(22, ">f")


@pytest.mark.parametrize("config", [{"block_index": 11}, {}])
def test_another_block_or_version_is_not_connected(
    plc: Plc, relay: Relay, config: dict[str, int]
) -> None:
    plc.put(46, ">H", 2)
    with pytest.raises(RejectedError) as caught, connected(relay.port, **config):
        pass
    assert caught.value.effect is Effect.NONE
    assert "does not exist" in caught.value.message or "version 2" in caught.value.message


def test_somebody_counts_while_the_line_is_open(plc: Plc, relay: Relay) -> None:
    before = plc.get(10, ">H")
    with connected(relay.port, watchdog_s=3) as furnace:
        until(lambda: plc.get(10, ">H") != before)
        first = plc.get(10, ">H")
        until(lambda: plc.get(10, ">H") == (first + 1) % 65536, 3.0)
        furnace.close()
        until(lambda: not furnace.transport.is_open)
        last = plc.get(10, ">H")
        time.sleep(1.3)
        assert plc.get(10, ">H") == last


@pytest.mark.parametrize(
    ("error", "sort", "effect"),
    [
        (failure_of_item(0x0A, "DB11", "x"), RejectedError, Effect.NONE),
        (failure_of_item(0x03, "DB10", "x"), RejectedError, Effect.NONE),
        (failure_of_item(0x01, "DB10", "x"), DeviceError, Effect.UNKNOWN),
        (failure_of_item(0x42, "DB10", "x"), FrameError, Effect.UNKNOWN),
        (failure_of_job(0x8104, "x"), RejectedError, Effect.NONE),
        (failure_of_job(0x8503, "x"), DeviceError, Effect.UNKNOWN),
    ],
)
def test_a_code_says_what_may_have_happened(
    error: DeviceError, sort: type[DeviceError], effect: Effect
) -> None:
    assert type(error) is sort
    assert error.effect is effect


def test_a_controller_has_one_line_whichever_its_rack() -> None:
    assert line_key("s7://10.0.0.7:102/0/1") == "tcp:10.0.0.7:102"
    assert addresses_of("s7://10.0.0.7:102/0/1") == (("10.0.0.7", 102),)
