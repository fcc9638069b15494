"""Serial and TCP lines: whole answers, honest effects, one owner."""

from __future__ import annotations

import os
import re
import signal
import socket
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.transports import tcp
from drivers.transports.base import ByteTransport
from drivers.transports.urls import make_transport, open_transport
from labweb.domain.errors import DeviceTimeoutError, Effect, FrameError, UnreachableError
from tests.drivers.wire import answering
from tests.workers.bench import PumpProcess


def opened(url: str) -> ByteTransport:
    transport = open_transport(url)
    assert isinstance(transport, ByteTransport)
    return transport


def test_an_exchange_returns_the_answer_up_to_its_terminator() -> None:
    with answering(lambda request: request.upper() + b"left over") as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        assert line.exchange(b"hi\r\n", until=b"\r\n", timeout_s=2) == b"HI\r\n"
        assert line.exchange(b"ho\r\n", until=b"\r\n", timeout_s=2) == b"HO\r\n"
        line.close()


def test_an_answer_without_an_end_mark_is_read_by_the_pattern_of_a_whole_one() -> None:
    frame = re.compile(rb"\xcc.{3}", re.DOTALL)
    with answering(lambda _: b"\x00noise\xcc\xcc\n1") as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        assert line.exchange(b"?", until=frame, timeout_s=2).endswith(b"\xcc\xcc\n1")
        line.close()


def test_a_wait_for_an_answer_can_be_given_up_and_what_comes_late_is_thrown_away() -> None:
    is_given_up = threading.Event()

    def late(request: bytes) -> bytes:
        if request == b"move\n":
            is_given_up.wait(5)
            return b"moved\n"
        return request

    with answering(late) as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        line.send(b"move\n")
        began_s = time.monotonic()
        threading.Timer(0.1, is_given_up.set).start()
        with pytest.raises(DeviceTimeoutError) as caught:
            line.receive(until=b"never", timeout_s=30, unless=is_given_up.is_set)
        assert caught.value.effect is Effect.UNKNOWN
        assert time.monotonic() - began_s < 10
        assert line.exchange(b"ask\n", until=b"\n", timeout_s=2) == b"ask\n"
        line.close()


def test_the_observer_sees_bytes_before_they_go_and_after_they_came() -> None:
    seen: list[tuple[str, bytes]] = []
    with answering(lambda request: request) as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        line.observer = lambda direction, data: seen.append((direction, data))
        line.exchange(b"a\n", until=b"\n", timeout_s=2)
        line.close()
    assert seen == [("out", b"a\n"), ("in", b"a\n")]


def test_an_answer_may_end_at_the_length_that_its_first_byte_tells() -> None:
    with answering(lambda request: b"\x03abcleft over") as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        answer = line.exchange(b"?", until=lambda data: data[0] + 1 if data else None, timeout_s=2)
        assert answer == b"\x03abc"
        line.close()


def test_an_answer_longer_than_is_allowed_is_noise() -> None:
    with answering(lambda request: b"x" * 100 + b"\n") as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        with pytest.raises(FrameError):
            line.exchange(b"?", until=b"#", timeout_s=2, longest_bytes=50)
        line.close()


def test_commands_are_kept_as_far_apart_as_the_instrument_needs() -> None:
    with answering(lambda request: request) as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        line.exchange(b"a\n", until=b"\n", timeout_s=2)
        started_s = time.monotonic()
        line.send(b"b\n", gap_s=0.1)
        line.exchange(b"c\n", until=b"c\n", timeout_s=2, gap_s=0.1)
        assert time.monotonic() - started_s >= 0.2
        line.close()


def test_an_observer_that_fails_keeps_the_bytes_from_going() -> None:
    arrived: list[bytes] = []

    def keep(request: bytes) -> bytes:
        arrived.append(request)
        return request

    def fail(direction: str, data: bytes) -> None:
        raise KeyboardInterrupt

    with answering(keep) as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        line.observer = fail
        with pytest.raises(KeyboardInterrupt):
            line.exchange(b"a\n", until=b"\n", timeout_s=1)
        line.close()
    assert arrived == []


def test_silence_is_a_timeout_of_unknown_effect() -> None:
    with answering(lambda request: b"half") as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        with pytest.raises(DeviceTimeoutError) as caught:
            line.exchange(b"a\n", until=b"\n", timeout_s=0.1)
        line.close()
    assert caught.value.effect is Effect.UNKNOWN
    assert caught.value.context == {"line": line.line, "received": b"half".hex()}


def test_a_late_answer_is_not_taken_for_the_next_one() -> None:
    late = threading.Event()

    def answer(request: bytes) -> bytes:
        if request == b"slow\n":
            late.wait(0.15)
        return request

    with answering(answer) as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        with pytest.raises(DeviceTimeoutError):
            line.exchange(b"slow\n", until=b"\n", timeout_s=0.12)
        assert line.exchange(b"fast\n", until=b"\n", timeout_s=2) == b"fast\n"
        line.close()


def test_what_a_device_that_was_held_up_answers_is_not_taken_for_the_next_answer(
    tmp_path: Path,
) -> None:
    """Its answers do not say to what, and those to both requests come at once."""
    pump = PumpProcess(tmp_path)
    line = opened(pump.url)
    os.kill(pump.popen.pid, signal.SIGSTOP)
    with pytest.raises(DeviceTimeoutError):
        line.exchange(b"/1?19\r", until=b"\x03\r\n", timeout_s=0.2)
    threading.Timer(0.3, os.kill, (pump.popen.pid, signal.SIGCONT)).start()
    assert b"TEST 1.0" in line.exchange(b"/1?23\r", until=b"\x03\r\n", timeout_s=5)
    line.close()
    pump.end()


@pytest.mark.parametrize("hangs_up", [False, True])
def test_a_word_to_halt_goes_through_where_no_second_connection_is_let_in(
    hangs_up: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tcp, "QUIET_S", 5.0)  # a busy machine takes its time to hang up
    heard: list[bytes] = []
    server = socket.create_server(("127.0.0.1", 0))
    address = server.getsockname()

    def serve() -> None:
        first, _ = server.accept()
        if not hangs_up:
            server.close()
        while data := first.recv(100):
            heard.append(data)
            if data == b"STOP\n":
                first.sendall(b"stopped\n")
            elif hangs_up:
                threading.Thread(target=turn_away, daemon=True).start()
        first.close()

    def turn_away() -> None:
        second, _ = server.accept()
        second.close()

    thread = threading.Thread(target=serve)
    thread.start()
    line = opened(f"tcp://127.0.0.1:{address[1]}")
    with pytest.raises(DeviceTimeoutError):
        line.exchange(b"READ\n", until=b"\n", timeout_s=0.1)
    assert line.exchange(b"STOP\n", until=b"\n", timeout_s=5) == b"stopped\n"
    line.close()
    thread.join()
    server.close()
    assert heard == [b"READ\n", b"STOP\n"]


def test_an_endless_answer_is_cut_at_four_kibibytes() -> None:
    with answering(lambda request: b"x" * 5000) as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        with pytest.raises(FrameError):
            line.exchange(b"a\n", until=b"\n", timeout_s=2)
        line.close()


def test_a_line_that_hangs_up_is_unreachable_and_can_be_opened_again() -> None:
    answers = iter([None, b"again\n"])
    with answering(lambda request: next(answers)) as port:
        line = opened(f"tcp://127.0.0.1:{port}")
        with pytest.raises(UnreachableError) as caught:
            line.exchange(b"a\n", until=b"\n", timeout_s=2)
        assert caught.value.effect is Effect.UNKNOWN
        assert not line.is_open
        with pytest.raises(UnreachableError) as caught:
            line.exchange(b"a\n", until=b"\n", timeout_s=2)
        assert caught.value.effect is Effect.NONE
        line.open()
        assert line.exchange(b"a\n", until=b"\n", timeout_s=2) == b"again\n"
        line.close()


def test_a_line_has_one_owner() -> None:
    with answering(lambda request: request) as port:
        first = opened(f"tcp://127.0.0.1:{port}")
        second = make_transport(f"tcp://127.0.0.1:{port}")
        with pytest.raises(UnreachableError, match="already open") as caught:
            second.open()
        assert caught.value.effect is Effect.NONE
        first.close()
        second.open()
        second.close()


def test_a_shared_line_closes_with_its_last_user() -> None:
    one, other = object(), object()
    with answering(lambda request: request) as port:
        line = make_transport(f"tcp://127.0.0.1:{port}")
        line.acquire(one)
        line.acquire(other)
        line.release(one)
        line.release(one)
        assert line.is_open
        line.release(other)
        assert not line.is_open


def test_nobody_listening_is_unreachable_without_effect() -> None:
    with answering(lambda request: request) as port:
        pass
    with pytest.raises(UnreachableError) as caught:
        open_transport(f"tcp://127.0.0.1:{port}")
    assert caught.value.effect is Effect.NONE


@pytest.fixture
def pseudo_terminal() -> Iterator[tuple[int, str]]:
    main, other = os.openpty()
    tty.setraw(other)
    yield main, os.ttyname(other)
    os.close(main)
    os.close(other)


def test_a_serial_port_carries_an_exchange(pseudo_terminal: tuple[int, str]) -> None:
    main, path = pseudo_terminal
    answerer = threading.Thread(target=lambda: os.write(main, os.read(main, 64).upper()))
    answerer.start()
    line = opened(f"serial://{path}?baud=9600&format=8N1")
    assert line.exchange(b"in_pv_1\r\n", until=b"\r\n", timeout_s=5) == b"IN_PV_1\r\n"
    answerer.join(5)
    line.close()


def test_a_serial_port_that_somebody_holds_is_unreachable(
    pseudo_terminal: tuple[int, str],
) -> None:
    _, path = pseudo_terminal
    line = opened(f"serial://{path}")
    with pytest.raises(UnreachableError) as caught:
        open_transport(f"serial://{path}")
    assert caught.value.effect is Effect.NONE
    line.close()


def test_a_serial_port_that_is_not_there_is_unreachable() -> None:
    with pytest.raises(UnreachableError) as caught:
        open_transport("serial:///dev/does-not-exist")
    assert caught.value.effect is Effect.NONE
