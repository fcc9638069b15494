"""The 2F-85 over Modbus, register by register, with fingers that take a while to move."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, cast

import pytest

from drivers.load import read_statuses
from drivers.logistics import robotiq_2f85
from drivers.logistics.robotiq_2f85 import Robotiq2F85, decode_state, encode_action
from drivers.transports import modbus
from drivers.transports.modbus import RegisterTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.conformance.placed_models import Doing
from tests.drivers.wire import answering
from tests.fixtures.running import until

CLOSE = ("grip", {"width_mm": 10.0, "speed_mm_s": 150.0, "force_n": 40.0})


class Fingers:
    """Registers of a gripper, moved on by every question about them."""

    def __init__(self, thing: int | None = None) -> None:
        self.thing = thing
        """Position at which something stops closing fingers."""

        self.action = self.activation = self.fault = self.asked = self.position = self.found = 0
        self.step = 60
        self.outside: int | None = None
        """Position at which something stops opening fingers."""

        self.written: list[list[int]] = []
        self.spoil: Callable[[int, bytes], bytes | None] = lambda _, answer: answer

    def __call__(self, request: bytes) -> bytes | None:
        assert request[6] == 9
        function = request[7]
        if function == 4:
            assert request[8:12].hex() == "07d00003"
            self.move()
            words = self.words()
            body = bytes([9, 4, 6]) + b"".join(word.to_bytes(2, "big") for word in words)
        else:
            assert (function, request[8:13].hex()) == (16, "03e8000306")
            words = [int.from_bytes(request[at : at + 2], "big") for at in (13, 15, 17)]
            self.written.append(words)
            self.take(words)
            body = bytes([9, 16]) + request[8:12]
        return self.spoil(function, request[:4] + len(body).to_bytes(2, "big") + body)

    def take(self, words: list[int]) -> None:
        before, self.action = self.action, words[0] >> 8
        if not self.action & 1:
            self.activation = self.found = self.fault = 0
        elif not before & 1:
            self.activation = 1
        if self.action & 8:
            self.asked = words[1] & 0xFF
            self.found = 0 if self.asked != self.position else 3

    def move(self) -> None:
        if self.activation == 1 and self.action & 1:
            self.activation, self.position, self.found = 3, 0, 3
        elif self.action & 8 and self.found == 0 and not self.fault:
            way = max(-self.step, min(self.step, self.asked - self.position))
            self.position += way
            if self.thing is not None and way > 0 and self.position >= self.thing:
                self.position, self.found = self.thing, 2
            elif self.outside is not None and way < 0 and self.position <= self.outside:
                self.position, self.found = self.outside, 1
            elif self.position == self.asked:
                self.found = 3

    def words(self) -> list[int]:
        status = self.action & 9 | self.activation << 4 | self.found << 6
        return [status << 8, self.fault << 8 | self.asked, self.position << 8 | 7]


@contextmanager
def gripper(fingers: Fingers, **config: object) -> Iterator[Robotiq2F85]:
    with answering(fingers) as port:
        line = make_transport(f"modbus+tcp://127.0.0.1:{port}?device=9")
        settings = {"max_force_n": 100.0, "poll_s": 0.005, "move_limit_s": 1.0, **config}
        device = Robotiq2F85(cast("RegisterTransport", line), settings)
        device.connect()
        try:
            yield device
        finally:
            device.close()


@pytest.fixture
def fingers() -> Fingers:
    """Fingers that are activated and open, around a thing of 45 mm."""
    found = Fingers(thing=120)
    found.action, found.activation, found.found = 1, 3, 3
    return found


def test_registers_are_those_of_the_manual() -> None:
    assert encode_action(0x09, 255, 255, 255) == [0x0900, 0x00FF, 0xFFFF]
    state = decode_state([0xB900, 0x00FF, 0x7D0A])
    assert (state.action, state.activation, state.found) == (9, 3, 2)
    assert (state.fault, state.asked, state.position, state.current) == (0, 255, 125, 10)
    with pytest.raises(FrameError):
        decode_state([0x2900, 0, 0])


def test_it_is_reset_and_activated() -> None:
    fingers = Fingers()
    with gripper(fingers) as device:
        assert device.is_initialized() is False
        assert device.initialize().evidence["width_mm"] == 85.0
        assert device.is_initialized() is True
    assert fingers.written == [[0, 0, 0], [0x0100, 0, 0]]


def test_a_thing_is_gripped_and_released(fingers: Fingers) -> None:
    with gripper(fingers) as device:
        evidence = device.grip(10.0, 150.0, 40.0).evidence
        assert evidence == {"width_mm": 45.0, "is_holding": True, "current_ma": 70}
        assert fingers.written == [[0x0900, 225, 255 << 8 | 24]]
        told = {"width_mm": 45.0, "is_holding": True, "is_initialized": True}
        assert read_statuses(device) == told
        with pytest.raises(RejectedError, match="holds something") as caught:
            device.initialize()
        assert caught.value.effect is Effect.NONE
        assert device.release(85.0, 20.0).evidence["is_holding"] is False
        assert fingers.position == 0


def test_closing_on_nothing_is_no_success(fingers: Fingers) -> None:
    fingers.thing = None
    with gripper(fingers) as device, pytest.raises(DeviceError, match="nothing") as caught:
        device.grip(10.0, 150.0, 40.0)
    assert (caught.value.code, caught.value.effect) == ("device.not_held", Effect.PARTIAL)
    assert caught.value.context["width_mm"] == 10.0


def test_a_thing_outside_stops_the_release(fingers: Fingers) -> None:
    fingers.position, fingers.outside = 200, 80
    with gripper(fingers) as device, pytest.raises(DeviceError, match="a thing stopped") as caught:
        device.release(85.0, 20.0)
    assert (caught.value.code, caught.value.effect) == ("device.not_reached", Effect.PARTIAL)


def test_what_stood_there_from_the_last_move_does_not_end_this_one(fingers: Fingers) -> None:
    fingers.found, fingers.position = 2, 120
    slow = Fingers.take

    def keeps_the_old_word(words: list[int]) -> None:
        slow(fingers, words)
        fingers.found = 2
        threading.Timer(0.05, lambda: setattr(fingers, "found", 0)).start()

    fingers.take = keeps_the_old_word  # type: ignore[method-assign]
    with gripper(fingers) as device:
        assert device.release(85.0, 150.0).evidence["width_mm"] == 85.0


@pytest.mark.parametrize(
    ("act", "why"),
    [
        (("grip", (60.0, 50.0, 40.0)), "release first"),
        (("release", (20.0, 50.0)), "to release is to open"),
    ],
)
def test_to_grip_is_to_close_and_to_release_is_to_open(
    fingers: Fingers, act: tuple[str, tuple[float, ...]], why: str
) -> None:
    fingers.position = 120
    with gripper(fingers) as device, pytest.raises(RejectedError, match=why) as caught:
        getattr(device, act[0])(*act[1])
    assert caught.value.effect is Effect.NONE
    assert fingers.written == []


@pytest.mark.parametrize(("activation", "fault"), [(0, 0), (1, 0), (3, 0x0E), (0, 0x0D)])
def test_a_gripper_that_is_not_ready_moves_nothing(
    fingers: Fingers, activation: int, fault: int
) -> None:
    fingers.activation, fingers.fault = activation, fault
    fingers.action = 0 if activation == 1 else 1
    with gripper(fingers) as device, pytest.raises(RejectedError) as caught:
        device.grip(10.0, 150.0, 40.0)
    assert caught.value.effect is Effect.NONE
    assert fingers.written == []


def test_more_force_than_the_lab_allows_is_refused_before_a_byte_is_sent(fingers: Fingers) -> None:
    with gripper(fingers) as device:
        sent: list[bytes] = []
        device.transport.observer = lambda _, data: sent.append(data)
        with pytest.raises(PreconditionError, match="force 101"):
            device.grip(10.0, 150.0, 101.0)
        assert sent == []


def test_a_fault_on_the_way_ends_the_move(fingers: Fingers) -> None:
    fingers.step = 0
    with gripper(fingers) as device:
        doing = Doing(device, CLOSE)
        until(lambda: bool(fingers.written))
        fingers.fault = 0x0E
        error = doing.failure()
    assert (error.code, error.effect) == ("device.alarm", Effect.PARTIAL)
    assert "current is too high" in error.message


def test_a_stop_leaves_the_fingers_where_they_are(fingers: Fingers) -> None:
    fingers.step = 0
    with gripper(fingers) as device:
        doing = Doing(device, CLOSE)
        until(lambda: bool(fingers.written))
        device.stop()
        error = doing.failure()
    assert (error.code, error.effect) == ("device.stopped", Effect.PARTIAL)
    assert fingers.written[-1] == [0x0100, 0, 0]


def test_a_gripper_that_was_never_activated_is_not_activated_by_a_halt() -> None:
    fingers = Fingers()
    with gripper(fingers) as device:
        device.halt()
    assert fingers.written == []


@pytest.mark.parametrize("spoilt", [b"", None])
def test_a_lost_answer_is_unknown_and_not_sent_again(
    fingers: Fingers, spoilt: bytes | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(modbus, "OPEN_TIMEOUT_S", 0.2)
    fingers.spoil = lambda function, answer: spoilt if function == 16 else answer
    with gripper(fingers) as device, pytest.raises(DeviceError) as caught:
        device.grip(10.0, 150.0, 40.0)
    assert caught.value.effect is Effect.UNKNOWN
    assert sum(words[0] == 0x0900 for words in fingers.written) == 1


def test_silence_before_the_move_has_no_effect(
    fingers: Fingers, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(modbus, "OPEN_TIMEOUT_S", 0.2)
    with gripper(fingers) as device:
        fingers.spoil = lambda _, __: b""
        with pytest.raises(DeviceTimeoutError) as caught:
            device.grip(10.0, 150.0, 40.0)
    assert caught.value.effect is Effect.NONE


def test_a_busy_gripper_moves_nothing(fingers: Fingers) -> None:
    def busy(function: int, answer: bytes) -> bytes:
        refusal = bytes([9, function | 0x80, 6])
        return answer[:4] + len(refusal).to_bytes(2, "big") + refusal if function == 16 else answer

    fingers.take = lambda words: None  # type: ignore[method-assign]
    fingers.spoil = busy
    with gripper(fingers) as device, pytest.raises(RejectedError, match="busy") as caught:
        device.grip(10.0, 150.0, 40.0)
    assert caught.value.effect is Effect.NONE


def test_a_move_that_does_not_end_is_slow(fingers: Fingers) -> None:
    fingers.step = 0
    with gripper(fingers, move_limit_s=0.1) as device, pytest.raises(DeviceError) as caught:
        device.grip(10.0, 150.0, 40.0)
    assert (caught.value.code, caught.value.effect) == ("device.slow", Effect.PARTIAL)


def test_every_fault_of_the_manual_has_a_name() -> None:
    known: dict[int, Any] = robotiq_2f85.FAULTS
    assert sorted(known) == [5, 7, 8, 10, 11, 12, 13, 14, 15]
