"""The live stream of a server that closes it at once."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from labweb_client import CallRefusedError
from labweb_client.live import follow, follow_async

_GUID = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
"""What a server adds to the key of a WebSocket (RFC 6455, 1.3)."""

_CLOSE_4401 = b"\x88\x02" + (4401).to_bytes(2, "big")
_TIMES = 20
"""How often it is tried: the close arrives before or after the first frame of the client."""


def _accept(channel: socket.socket) -> None:
    asked = b""
    while b"\r\n\r\n" not in asked:
        asked += channel.recv(4096)
    key = next(
        line.split(b":", 1)[1].strip()
        for line in asked.split(b"\r\n")
        if line.lower().startswith(b"sec-websocket-key")
    )
    accepted = base64.b64encode(hashlib.sha1(key + _GUID, usedforsecurity=False).digest())
    channel.sendall(
        b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Accept: " + accepted + b"\r\n\r\n" + _CLOSE_4401
    )
    channel.recv(4096)


@contextmanager
def _closing_server() -> Iterator[str]:
    """Serve a stream whose answer to the handshake carries its close, in one packet."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            for _ in range(_TIMES):
                channel, _peer = listener.accept()
                with channel:
                    _accept(channel)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        thread.join(10)


def test_a_stream_that_is_closed_before_the_first_frame_says_why() -> None:
    with _closing_server() as url:
        for _ in range(_TIMES):
            with (
                pytest.raises(CallRefusedError) as refused,
                follow(url, "labweb_guess", ["runs"]),
            ):
                pytest.fail("it was subscribed")
            assert refused.value.status == 401


def test_an_asynchronous_stream_says_why_it_was_closed() -> None:
    async def ask(url: str) -> None:
        async with follow_async(url, "labweb_guess", ["runs"]):
            pytest.fail("it was subscribed")

    with _closing_server() as url:
        for _ in range(_TIMES):
            with pytest.raises(CallRefusedError) as refused:
                asyncio.run(ask(url))
            assert refused.value.status == 401
