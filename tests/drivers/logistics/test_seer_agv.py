"""The Robokit interface against its published frames, and a simulated vehicle that drives."""

import json
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import pytest

from drivers.load import read_statuses
from drivers.logistics.seer_agv import SeerAgv, decode_answer, encode_request, whole_answer
from drivers.transports.base import ByteTransport
from drivers.transports.tcp import TcpTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
    UnreachableError,
)
from tests.drivers.conformance.movers import MOVERS
from tests.drivers.conformance.placed_models import (
    Action,
    Bench,
    Doing,
    do,
    impatient,
    running,
    sent_by,
)
from tests.drivers.conftest import Play
from tests.drivers.wire import Answer, answering
from tests.fixtures.running import until

CASE = next(case for case in MOVERS if case.model == "seer_agv")
THERE: Action = ("drive_to", {"station": "LM3"})
BACK: Action = ("drive_to", {"station": "LM1"})


def reply(request: bytes, body: object, *, kind: int = 0, number: int = 0) -> bytes:
    """Frame an answer as the maker's table has it, without the driver's own codec."""
    asked = struct.unpack(">H", request[2:4])[0]
    sort = struct.unpack(">H", request[8:10])[0]
    data = body if isinstance(body, bytes) else json.dumps(body).encode()
    head = struct.pack(">BBHIH6x", 0x5A, 1, number or asked, len(data), kind or sort + 10_000)
    return head + data


STANDS = {
    1004: {"ret_code": 0, "x": 1.0, "y": 2.0, "confidence": 0.9, "current_station": "LM1"},
    1020: {"ret_code": 0, "task_status": 4, "target_id": "LM1"},
}


def told(answers: Mapping[int, object]) -> Answer:
    def answer(request: bytes) -> bytes:
        return reply(request, answers[struct.unpack(">H", request[8:10])[0]])

    return answer


def line(url: str) -> ByteTransport:
    found = make_transport(url)
    assert isinstance(found, ByteTransport)
    return found


@contextmanager
def vehicle(status: Answer, navigation: Answer) -> Iterator[SeerAgv]:
    """Connect a driver to two ports that answer as they are told."""
    with answering(status) as first, answering(navigation) as second:
        transport = line(f"tcp://127.0.0.1:{first}?also={second}")
        device = SeerAgv(transport, {"stations": ["LM1", "LM2"], "poll_s": 0.01})
        device.transport.open()
        try:
            yield device
        finally:
            device.transport.close()


def test_frames_are_those_of_the_published_protocol() -> None:
    assert encode_request(1, 1004, {}).hex() == "5a0100010000000003ec000000000000"
    sent = encode_request(2, 3051, {"id": "LM1"})
    assert sent == bytes.fromhex("5a010002 0000000d 0beb 000000000000") + b'{"id": "LM1"}'
    answer = reply(sent, {"ret_code": 0})
    assert whole_answer(answer[:12]) is None
    assert whole_answer(answer) == len(answer)
    assert decode_answer(answer, 2, 3051) == {"ret_code": 0}


@pytest.mark.parametrize(
    "answer",
    [
        reply(encode_request(1, 1004, {}), {"ret_code": 0}, number=2),
        reply(encode_request(1, 1004, {}), {"ret_code": 0}, kind=11_020),
        reply(encode_request(1, 1004, {}), b"[]"),
        reply(encode_request(1, 1004, {}), b"{"),
        reply(encode_request(1, 1004, {}), b"\xff"),
        reply(encode_request(1, 1004, {}), {"ret_code": "0"}),
        reply(encode_request(1, 1004, {}), {}),
    ],
)
def test_an_answer_that_is_none_is_a_frame_error(answer: bytes) -> None:
    with pytest.raises(FrameError):
        decode_answer(answer, 1, 1004)


def test_noise_before_an_answer_is_seen_at_its_first_byte() -> None:
    with pytest.raises(FrameError):
        whole_answer(b"\x00")


@pytest.mark.parametrize("value", [None, "1", True, "NaN"])
def test_a_place_that_is_no_number_is_never_told(value: object) -> None:
    place = {**STANDS[1004], "x": float("nan") if value == "NaN" else value}
    with vehicle(told({1004: place}), told({})) as device, pytest.raises(FrameError):
        device.x_mm()


def test_an_address_without_the_port_of_navigation_is_refused() -> None:
    with answering(told(STANDS)) as port:
        device = SeerAgv(line(f"tcp://127.0.0.1:{port}"), {"stations": ["LM1"]})
        with pytest.raises(RejectedError, match="also=19206") as caught:
            device.connect()
    assert caught.value.effect is Effect.NONE
    assert not device.transport.is_open


def test_a_port_of_navigation_that_nobody_opens_leaves_no_half_open_line() -> None:
    with answering(told(STANDS)) as port, answering(told({})) as gone:
        pass
    with answering(told(STANDS)) as port:
        transport = line(f"tcp://127.0.0.1:{port}?also={gone}")
        with pytest.raises(UnreachableError) as caught:
            SeerAgv(transport, {"stations": ["LM1"]}).connect()
    assert caught.value.effect is Effect.NONE
    assert not transport.is_open


@pytest.mark.parametrize(
    ("answers", "why"),
    [
        ({1020: {"ret_code": 0, "task_status": 2, "target_id": "LM2"}}, "running"),
        ({1020: {"ret_code": 0, "task_status": 3, "target_id": "LM2"}}, "suspended"),
        ({1004: {**STANDS[1004], "confidence": 0.3}}, "sure of its place"),
        ({1004: {"ret_code": 40_000, "err_msg": "no map"}}, "no map"),
    ],
)
def test_a_vehicle_that_is_not_ready_is_sent_nowhere(
    answers: Mapping[int, object], why: str
) -> None:
    with vehicle(told({**STANDS, **answers}), told({})) as device:
        sent = sent_by(device)
        with pytest.raises(RejectedError, match=why) as caught:
            device.drive_to("LM2")
        assert caught.value.effect is Effect.NONE
        assert all(frame[8:10] in (b"\x03\xec", b"\x03\xfc") for frame in sent)


def test_an_order_that_is_refused_has_no_effect() -> None:
    refusal = {"ret_code": 40_012, "err_msg": "no station"}
    with vehicle(told(STANDS), told({3051: refusal})) as device:
        with pytest.raises(RejectedError, match="no station") as caught:
            device.drive_to("LM2")
        assert caught.value.effect is Effect.NONE


def test_an_order_that_somebody_else_changes_is_cancelled() -> None:
    tasks = iter([(4, "LM1"), (2, "LM2"), (2, "LM1"), (6, "LM1")])
    seen = []

    def status(request: bytes) -> bytes:
        if request[8:10] == b"\x03\xec":
            return reply(request, STANDS[1004])
        task, target = next(tasks)
        return reply(request, {"ret_code": 0, "task_status": task, "target_id": target})

    def navigation(request: bytes) -> bytes:
        seen.append(struct.unpack(">H", request[8:10])[0])
        return reply(request, {"ret_code": 0})

    with (
        vehicle(status, navigation) as device,
        pytest.raises(DeviceError, match="LM1") as caught,
    ):
        device.drive_to("LM2")
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.PARTIAL)
    assert caught.value.context["station"] == "LM1"
    assert seen == [3051, 3003]


def test_an_order_that_is_completed_elsewhere_is_no_success() -> None:
    tasks = iter([4, 4, 4])

    def status(request: bytes) -> bytes:
        if request[8:10] == b"\x03\xec":
            return reply(request, STANDS[1004])
        return reply(request, {"ret_code": 0, "task_status": next(tasks), "target_id": "LM2"})

    with (
        vehicle(status, told({3051: {"ret_code": 0}, 3003: {"ret_code": 0}})) as device,
        pytest.raises(DeviceError, match="'LM1'") as caught,
    ):
        device.drive_to("LM2")
    assert (caught.value.code, caught.value.effect) == ("device.not_reached", Effect.PARTIAL)


def test_it_says_what_was_recorded(play: Play) -> None:
    transport = play("seer_agv")
    transport.also = (transport,)  # both ports went into one transcript
    device = SeerAgv(transport, {"stations": ["LM2"], "poll_s": 0.005})
    device.identify()
    assert device.station() == "LM1"
    assert device.drive_to("LM2").evidence == {"station": "LM2", "x_mm": 4000.0, "y_mm": 0.0}
    assert device.stop_driving().evidence["station"] == "LM2"
    assert device.confidence_ratio() == 0.95


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running([CASE]) as bench:
        yield bench


def test_it_drives_to_a_station_and_back(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        before = len(bench.acts(CASE, "drive"))
        assert do(device, THERE).evidence == {"station": "LM3", "x_mm": 4000.0, "y_mm": 3000.0}
        assert read_statuses(device) == {
            "station": "LM3",
            "is_driving": False,
            "x_mm": 4000.0,
            "y_mm": 3000.0,
            "confidence_ratio": 0.95,
        }
        assert do(device, BACK).evidence["station"] == "LM1"
        assert len(bench.acts(CASE, "drive")) == before + 2
        assert bench.is_over(CASE, "drive")


def test_a_stop_on_the_way_says_where_it_stands(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        do(device, BACK)
        before = len(bench.acts(CASE, "drive"))
        doing = Doing(device, THERE)
        until(lambda: len(bench.acts(CASE, "drive")) > before)
        until(lambda: bench.state(CASE)["x"] > 0.5)
        device.stop()
        error = doing.failure()
        assert (error.code, error.effect) == ("device.stopped", Effect.PARTIAL)
        assert error.context["station"] == ""
        assert 500.0 < error.context["x_mm"] < 4000.0
        assert bench.is_over(CASE, "drive")


def test_a_blocked_way_ends_the_order(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        do(device, BACK)
        before = len(bench.acts(CASE, "drive"))
        doing = Doing(device, THERE)
        until(lambda: len(bench.acts(CASE, "drive")) > before)
        bench.inflict(CASE, "stall")
        error = doing.failure()
        assert (error.code, error.effect) == ("device.alarm", Effect.PARTIAL)
        assert error.context["task"] == "failed"


def test_a_lost_answer_to_the_order_is_unknown_and_not_sent_again(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient(monkeypatch, CASE)
    with bench.connected(CASE) as device:
        before = len(bench.acts(CASE, "drive"))
        sent = sent_by(device)
        bench.inflict(CASE, "no_answer", after_commands=2, executes=True)
        error = Doing(device, THERE).failure()
        assert isinstance(error, DeviceTimeoutError)
        assert error.effect is Effect.UNKNOWN
        assert "not_turned_off" in error.context
        assert len(bench.acts(CASE, "drive")) == before + 1
        assert [frame[8:10].hex() for frame in sent].count("0beb") == 1
        assert [frame[8:10].hex() for frame in sent][-1] == "0bbb"


def test_an_order_that_another_gave_is_not_overwritten_and_can_be_given_up(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        assert isinstance(device, SeerAgv)
        do(device, BACK)
        before = len(bench.acts(CASE, "drive"))
        device._ask(3051, {"id": "LM3"})
        with pytest.raises(RejectedError, match="'LM3' that is running") as caught:
            do(device, ("drive_to", {"station": "LM2"}))
        assert caught.value.effect is Effect.NONE
        assert do(device, ("stop_driving", {})).evidence["station"] == ""
        assert device.is_driving() is False
        assert len(bench.acts(CASE, "drive")) == before + 1
        assert bench.is_over(CASE, "drive")


def test_a_station_that_is_not_listed_is_refused(bench: Bench) -> None:
    with bench.connected(CASE, stations=["LM1"]) as device:
        sent = sent_by(device)
        with pytest.raises(PreconditionError, match="not listed"):
            do(device, THERE)
        assert sent == []


def test_a_port_that_breaks_closes_the_line_and_a_new_connection_opens_both(bench: Bench) -> None:
    with bench.connected(CASE) as device:
        assert isinstance(device.transport, TcpTransport)
        device.transport.also[0].close()
        assert not device.transport.is_open
        with pytest.raises(UnreachableError) as caught:
            do(device, THERE)
        assert caught.value.effect is Effect.NONE
        device.connect()
        assert device.transport.is_open
        assert all(one.is_open for one in device.transport.also)
