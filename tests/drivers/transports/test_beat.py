"""The datagram that keeps a device's watchdog quiet."""

from __future__ import annotations

import socket
from contextlib import suppress

import pytest

from drivers.transports.base import ByteTransport
from drivers.transports.urls import line_key, make_transport
from labweb.domain.errors import DefinitionError
from tests.drivers.wire import answering


def test_it_is_sent_again_and_again_while_the_line_is_open() -> None:
    with (
        answering(lambda _: b"") as port,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as watchdog,
    ):
        watchdog.bind(("127.0.0.1", 0))
        watchdog.settimeout(2.0)
        url = f"tcp://127.0.0.1:{port}?beat=127.0.0.1:{watchdog.getsockname()[1]}"
        transport = make_transport(url)
        assert isinstance(transport, ByteTransport)
        transport.open()
        transport.keep_alive(b"reset_wdt\0", 0.02)
        assert [watchdog.recv(64) for _ in range(3)] == [b"reset_wdt\0"] * 3
        transport.close()
        watchdog.setblocking(False)
        _drain(watchdog)  # what was on its way when it ended
        watchdog.settimeout(0.1)
        with pytest.raises(TimeoutError):
            watchdog.recv(64)


def _drain(watchdog: socket.socket) -> None:
    with suppress(BlockingIOError):
        while True:
            watchdog.recv(64)


def test_it_is_no_part_of_the_lines_name() -> None:
    assert line_key("tcp://10.0.0.9:5000?beat=10.0.255.255:3000") == "tcp:10.0.0.9:5000"


@pytest.mark.parametrize("beat", ["3000", "host:3000", "10.0.255.255:0", "10.0.255.255:http"])
def test_a_place_that_cannot_be_is_refused(beat: str) -> None:
    with pytest.raises(DefinitionError, match="tcp://"):
        make_transport(f"tcp://10.0.0.9:5000?beat={beat}")


def test_without_a_place_nothing_is_sent() -> None:
    with answering(lambda _: b"") as port:
        transport = make_transport(f"tcp://127.0.0.1:{port}")
        assert isinstance(transport, ByteTransport)
        transport.open()
        transport.keep_alive(b"reset_wdt\0", 0.02)
        transport.close()
