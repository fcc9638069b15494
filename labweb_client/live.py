"""What a server announces while something happens."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any
from urllib.parse import urlsplit, urlunsplit

import msgspec
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from labweb_client.errors import CallRefusedError, CallUnansweredError, LabwebError, ServerRefusal

PATH = "/ws/v1/"
_NOT_SIGNED_IN = 4401
_PING = msgspec.json.encode({"ping": 1})


class News(msgspec.Struct):
    """One announcement on a topic."""

    topic: str
    seq: int
    """Counts the announcements of the topic on this connection, from 1."""

    at_s: float
    """When the server said it, in seconds since 1970-01-01 UTC."""

    data: dict[str, Any]


class _Frame(msgspec.Struct):
    topic: str = ""
    seq: int = 0
    at: float = 0.0
    data: dict[str, Any] = msgspec.field(default_factory=dict)
    pong: int | None = None
    error: dict[str, Any] | None = None


def address_of(url: str) -> str:
    """Return the address of the stream of a server."""
    parts = urlsplit(url)
    scheme = "wss" if parts.scheme == "https" else "ws"
    return urlunsplit((scheme, parts.netloc, PATH, "", ""))


@contextmanager
def follow(url: str, token: str, topics: Iterable[str]) -> Iterator[Iterator[News]]:
    """Subscribe to some topics; what is announced from then on is yielded until the stream ends.

    Raises:
        CallRefusedError: The token is not valid, or one of the topics is none.
        CallUnansweredError: The stream ended, by either side; what is announced meanwhile is lost.
    """
    with connect(address_of(url), additional_headers=_headers(token)) as socket:

        def listen() -> Iterator[_Frame]:
            while True:
                with _reason_of_close():
                    frame = socket.recv()
                yield _read(frame)

        with _reason_of_close():
            socket.send(_subscription(topics), text=True)
            socket.send(_PING, text=True)
        frames = listen()
        early = []
        for frame in frames:
            if frame.pong is not None:
                break
            early.append(frame)
        yield (_news(frame) for frames_ in (early, frames) for frame in frames_)


@asynccontextmanager
async def follow_async(
    url: str, token: str, topics: Iterable[str]
) -> AsyncIterator[AsyncIterator[News]]:
    """Subscribe as `follow` does."""
    async with connect_async(address_of(url), additional_headers=_headers(token)) as socket:

        async def listen() -> AsyncIterator[_Frame]:
            while True:
                with _reason_of_close():
                    frame = await socket.recv()
                yield _read(frame)

        with _reason_of_close():
            await socket.send(_subscription(topics), text=True)
            await socket.send(_PING, text=True)
        frames = listen()
        early = []
        async for frame in frames:
            if frame.pong is not None:
                break
            early.append(frame)

        async def told() -> AsyncIterator[News]:
            for frame in early:
                yield _news(frame)
            async for frame in frames:
                yield _news(frame)

        yield told()


def _headers(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def _subscription(topics: Iterable[str]) -> bytes:
    return msgspec.json.encode({"subscribe": list(topics)})


def _read(frame: str | bytes) -> _Frame:
    found = msgspec.json.decode(frame, type=_Frame)
    if found.error is not None:
        code = str(found.error.get("code", "feed.refused"))
        raise CallRefusedError(404, ServerRefusal(code, str(found.error.get("message", ""))))
    return found


def _news(frame: _Frame) -> News:
    return News(frame.topic, frame.seq, frame.at, frame.data)


@contextmanager
def _reason_of_close() -> Iterator[None]:
    """Say why the server closed the stream: it may do so before the first frame is sent."""
    try:
        yield
    except ConnectionClosed as error:
        raise _ended(error) from error


def _ended(error: ConnectionClosed) -> LabwebError:
    if error.rcvd is not None and error.rcvd.code == _NOT_SIGNED_IN:
        text = "the access token is unknown, expired or revoked"
        return CallRefusedError(401, ServerRefusal("http.token_refused", text))
    return CallUnansweredError(f"the stream ended: {error}; read again what you follow")
