"""GRBL 1.1 line by line, and a controller whose axes take a while to move."""

import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from drivers.load import read_statuses
from drivers.logistics import grbl_gantry
from drivers.logistics._grbl import decode_answer, decode_report, encode_move
from drivers.logistics.grbl_gantry import GrblGantry
from drivers.transports.base import ByteTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import (
    DefinitionError,
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.conformance.placed_models import Doing, sent_by
from tests.drivers.wire import answering
from tests.fixtures.running import until

BOX = {
    "low_x_mm": -200.0,
    "high_x_mm": 0.0,
    "low_y_mm": -200.0,
    "high_y_mm": 0.0,
    "low_z_mm": -100.0,
    "high_z_mm": 0.0,
    "max_speed_mm_s": 50.0,
}
THERE = ("move_to", {"x_mm": -100.0, "y_mm": -50.0, "z_mm": -10.0, "speed_mm_s": 20.0})
GREETING = b"\r\nGrbl 1.1h ['$' for help]\r\n"


class Controller:
    """What the wiki says of lines and real-time bytes; every report moves it on by a step."""

    def __init__(self, state: str = "Idle") -> None:
        self.state = state
        self.place = [-1.0, -1.0, -1.0]
        self.goal = list(self.place)
        self.step_mm = 40.0
        self.settings = {13: "0", 20: "1", 22: "1", 130: "200.000", 131: "200.000", 132: "100.000"}
        self.version = "1.1h.20190825"
        self.lines: list[str] = []
        self.home_s, self.home_end = 0.0, b"ok\r\n"
        self.refuse = b""
        self.spoil: Callable[[bytes, bytes], bytes | None] = lambda _, answer: answer

    def __call__(self, request: bytes) -> bytes | None:
        answer = b""
        for part in re.findall(rb"[?!~\x18]|[^?!~\x18\n]*\n", request):
            answer += self.answer(part)
        return self.spoil(request, answer)

    def answer(self, part: bytes) -> bytes:
        match part:
            case b"?":
                return self.report()
            case b"!":
                self.state = "Hold" if self.state == "Run" else self.state
                return b""
            case b"\x18":
                self.goal = list(self.place)
                self.state = "Idle" if self.state != "Run" else "Alarm"
                return GREETING
        line = part.decode().strip()
        self.lines.append(line)
        return self.refuse or self.act(line)

    def report(self) -> bytes:
        if self.state == "Run":
            for axis in range(3):
                gap = self.goal[axis] - self.place[axis]
                self.place[axis] += max(-self.step_mm, min(self.step_mm, gap))
            self.state = "Idle" if self.place == self.goal else "Run"
        where = ",".join(f"{value:.3f}" for value in self.place)
        feed = 1200 if self.state == "Run" else 0
        return f"<{self.state}|MPos:{where}|FS:{feed},0>\r\n".encode()

    def act(self, line: str) -> bytes:
        if line == "$I":
            return f"[VER:{self.version}:]\r\n[OPT:V,15,128]\r\nok\r\n".encode()
        if line == "$$":
            told = "".join(f"${number}={value}\r\n" for number, value in self.settings.items())
            return told.encode() + b"ok\r\n"
        if line == "$H":
            time.sleep(self.home_s)
            self.state = "Idle" if self.home_end.startswith(b"ok") else "Alarm"
            self.place = [-1.0, -1.0, -1.0]
            return self.home_end
        found = re.fullmatch(r"G21 G90 G53 G1 X(\S+) Y(\S+) Z(\S+) F(\S+)", line)
        assert found is not None, line
        if self.state == "Alarm":
            return b"error:9\r\n"
        self.goal, self.state = [float(found[axis]) for axis in (1, 2, 3)], "Run"
        return b"ok\r\n"


@contextmanager
def gantry(controller: Controller, **config: object) -> Iterator[GrblGantry]:
    with answering(controller) as port:
        line = make_transport(f"tcp://127.0.0.1:{port}")
        assert isinstance(line, ByteTransport)
        settings = {**BOX, "wake_s": 0.0, "poll_s": 0.01, "move_limit_s": 2.0, **config}
        device = GrblGantry(line, settings)
        device.connect()
        try:
            yield device
        finally:
            device.close()


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grbl_gantry, "ANSWER_S", 0.3)


def test_lines_and_reports_are_those_of_the_wiki() -> None:
    assert encode_move((1.0, -2.0, 0.5), 1.5) == "G21 G90 G53 G1 X1.000 Y-2.000 Z0.500 F90.0"
    seen = decode_report(
        b"<Hold:1|MPos:5.000,2.000,0.000|Bf:15,128|FS:12.5,8000|Ov:100,100,100>\r\n"
    )
    assert (seen.state, seen.step, seen.feed, seen.has_stopped) == ("Hold", "1", 12.5, False)
    assert decode_report(b"<Hold:0|MPos:5.0,2.0,0.0|FS:0,0>\r\n").has_stopped
    assert decode_answer(b"[MSG:Caution: Unlocked]\r\nok\r\n") == ["[MSG:Caution: Unlocked]"]


@pytest.mark.parametrize(
    "frame",
    [
        b"<Idle|WPos:0.000,0.000,0.000|FS:0,0>\r\n",
        b"<Idle|MPos:0.000,0.000|FS:0,0>\r\n",
        b"<Idle|MPos:0.000,0.000,nan|FS:0,0>\r\n",
        b"<Idle|MPos:0.000,0.000,0.000>\r\n",
        b"<Idle|MPos:0.000,0.000,0.000|FS:0.0.0,0>\r\n",
        b"ok\r\n<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n",
    ],
)
def test_a_report_that_is_none_is_a_frame_error(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_report(frame)


@pytest.mark.parametrize(("frame", "why"), [(b"error:15\r\n", "soft"), (b"error:99\r\n", "99")])
def test_an_error_is_a_refusal(frame: bytes, why: str) -> None:
    with pytest.raises(RejectedError, match=why) as caught:
        decode_answer(frame)
    assert caught.value.effect is Effect.NONE


def test_it_is_homed_and_moves() -> None:
    controller = Controller("Alarm")
    with gantry(controller) as device:
        with pytest.raises(RejectedError, match="initialize it first"):
            device.move_to(-100.0, -50.0, -10.0, 20.0)
        assert device.initialize().evidence["machine_state"] == "Idle"
        assert device.move_to(-100.0, -50.0, -10.0, 20.0).evidence == {
            "x_mm": -100.0,
            "y_mm": -50.0,
            "z_mm": -10.0,
            "machine_state": "Idle",
        }
        assert read_statuses(device) == {
            "x_mm": -100.0,
            "y_mm": -50.0,
            "z_mm": -10.0,
            "is_moving": False,
            "machine_state": "Idle",
        }
    moves = [line for line in controller.lines if line.startswith("G")]
    assert moves == ["G21 G90 G53 G1 X-100.000 Y-50.000 Z-10.000 F1200.0"]


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"version": "0.9j"}, "no GRBL 1.1"),
        ({"settings": {13: "0", 22: "0", 130: "200", 131: "200", 132: "100"}}, r"\$22=1"),
        ({"settings": {13: "1", 22: "1", 130: "200", 131: "200", 132: "100"}}, r"\$13=0"),
        ({"settings": {13: "0", 22: "1", 130: "199", 131: "200", 132: "100"}}, "travel is 199"),
    ],
)
def test_a_controller_whose_places_nobody_can_trust_is_not_connected(
    changed: dict[str, Any], why: str
) -> None:
    controller = Controller()
    for name, value in changed.items():
        setattr(controller, name, value)
    with pytest.raises(RejectedError, match=why) as caught, gantry(controller):
        pass
    assert caught.value.effect is Effect.NONE


def test_a_box_that_is_inside_out_is_refused() -> None:
    with pytest.raises(DefinitionError, match="low_z_mm is 1, above high_z_mm, 0"):
        GrblGantry(make_transport("tcp://127.0.0.1:1"), {**BOX, "low_z_mm": 1.0})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "place", [(-201.0, 0.0, 0.0, 20.0), (0.0, 0.5, 0.0, 20.0), (0.0, 0.0, 0.0, 51.0)]
)
def test_what_is_out_of_the_box_is_refused_before_a_byte_is_sent(
    place: tuple[float, float, float, float],
) -> None:
    with gantry(Controller()) as device:
        sent = sent_by(device)
        with pytest.raises(PreconditionError):
            device.move_to(*place)
        assert sent == []


@pytest.mark.parametrize("state", ["Run", "Hold", "Home", "Door", "Check", "Sleep", "Jog"])
def test_a_controller_that_is_not_idle_moves_nothing(state: str) -> None:
    controller = Controller(state)
    controller.step_mm = 0.0
    controller.goal = [0.0, 0.0, 0.0]
    with gantry(controller) as device, pytest.raises(RejectedError, match=state) as caught:
        device.move_to(-100.0, -50.0, -10.0, 20.0)
    assert caught.value.effect is Effect.NONE
    assert not any(line.startswith("G") for line in controller.lines)


def test_a_stop_holds_the_feed_and_tells_where(monkeypatch: pytest.MonkeyPatch) -> None:
    controller = Controller()
    controller.step_mm = 0.1
    with gantry(controller) as device:
        doing = Doing(device, THERE)
        until(lambda: controller.state == "Run")
        device.stop()
        error = doing.failure()
    assert (error.code, error.effect) == ("device.stopped", Effect.PARTIAL)
    assert -100.0 < error.context["x_mm"] <= -1.0
    assert controller.state == "Idle"


def test_an_alarm_on_the_way_leaves_it_unknown_since_the_position_is_lost() -> None:
    controller = Controller()
    controller.step_mm = 0.1
    with gantry(controller) as device:
        doing = Doing(device, THERE)
        until(lambda: controller.state == "Run")
        controller.state = "Alarm"
        error = doing.failure()
    assert (error.code, error.effect) == ("device.alarm", Effect.UNKNOWN)


def test_a_move_that_ends_elsewhere_is_no_success() -> None:
    controller = Controller()
    controller.step_mm = 0.1
    with gantry(controller) as device:
        doing = Doing(device, THERE)
        until(lambda: controller.state == "Run")
        controller.goal = list(controller.place)
        error = doing.failure()
    assert (error.code, error.effect) == ("device.alarm", Effect.PARTIAL)


@pytest.mark.parametrize(
    ("answer", "code", "effect"),
    [
        (b"error:33\r\n", "device.rejected", Effect.NONE),
        (b"ALARM:2\r\n", "device.alarm", Effect.UNKNOWN),
        (b"maybe\r\nok\r\n", "", Effect.NONE),
        (b"\xffok\r\n", "device.timeout", Effect.UNKNOWN),
        (b"\xff\r\nok\r\n", "device.frame", Effect.UNKNOWN),
        (GREETING, "device.timeout", Effect.UNKNOWN),
    ],
)
def test_what_a_move_is_answered_with_says_what_happened(
    answer: bytes, code: str, effect: Effect
) -> None:
    controller = Controller()
    with gantry(controller) as device:
        real = controller.act
        controller.act = lambda line: answer if real(line) else b""  # type: ignore[method-assign]
        if not code:
            device.move_to(-100.0, -50.0, -10.0, 20.0)
            return
        with pytest.raises(DeviceError) as caught:
            device.move_to(-100.0, -50.0, -10.0, 20.0)
    assert (caught.value.code, caught.value.effect) == (code, effect)
    assert sum(line.startswith("G") for line in controller.lines) == 1


def test_a_lost_answer_to_a_move_is_held_and_not_sent_again() -> None:
    controller = Controller()
    controller.step_mm = 0.1
    controller.spoil = lambda request, answer: b"" if request.startswith(b"G") else answer
    with gantry(controller) as device, pytest.raises(DeviceTimeoutError) as caught:
        device.move_to(-100.0, -50.0, -10.0, 20.0)
    assert caught.value.effect is Effect.UNKNOWN
    assert sum(line.startswith("G") for line in controller.lines) == 1
    assert controller.state == "Idle"


@pytest.mark.parametrize(
    ("end", "code", "effect"),
    [
        (b"error:5\r\n", "device.rejected", Effect.NONE),
        (b"ALARM:9\r\n", "device.alarm", Effect.UNKNOWN),
    ],
)
def test_homing_that_fails_says_what_happened(end: bytes, code: str, effect: Effect) -> None:
    controller = Controller()
    controller.home_end = end
    with gantry(controller) as device, pytest.raises(DeviceError) as caught:
        device.initialize()
    assert (caught.value.code, caught.value.effect) == (code, effect)


def test_a_stop_does_not_wait_for_homing() -> None:
    controller = Controller()
    real = controller.act
    controller.act = lambda line: b"" if line == "$H" else real(line)  # type: ignore[method-assign]
    with gantry(controller) as device:
        doing = Doing(device, ("initialize", {}))
        until(lambda: "$H" in controller.lines)
        controller.state = "Home"
        began_s = time.monotonic()
        device.stop()
        assert doing.failure().code == "device.stopped"
        assert time.monotonic() - began_s < 2.0
    assert controller.state == "Idle"


def test_two_who_stop_at_once_both_come_through() -> None:
    controller = Controller()
    controller.step_mm = 0.1
    with gantry(controller) as device:
        doing = Doing(device, THERE)
        until(lambda: controller.state == "Run")
        other = threading.Thread(target=device.halt)
        other.start()
        device.stop()
        other.join()
        assert doing.failure().effect is not Effect.NONE
    assert controller.state == "Idle"
