"""What a server announces while something happens."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable, Iterator
from typing import Any
from urllib.parse import urlsplit, urlunsplit

import msgspec
from websockets.asyncio.client import connect as connect_async
from websockets.sync.client import connect

PATH = "/ws/v1/"


class News(msgspec.Struct):
    """One announcement on a topic."""

    topic: str
    seq: int
    """Counts the announcements of the topic on this connection, from 1."""

    at: float
    """When the server said it, in seconds since 1970-01-01 UTC."""

    data: dict[str, Any]


class _Frame(msgspec.Struct):
    topic: str = ""
    seq: int = 0
    at: float = 0.0
    data: dict[str, Any] = msgspec.field(default_factory=dict)
    error: dict[str, Any] | None = None


class TopicRefusedError(Exception):
    """The server knows no such topic, or the owner of the token may not hear of it."""


def address_of(url: str) -> str:
    """Return the address of the stream of a server."""
    parts = urlsplit(url)
    scheme = "wss" if parts.scheme == "https" else "ws"
    return urlunsplit((scheme, parts.netloc, PATH, "", ""))


def follow(url: str, token: str, topics: Iterable[str]) -> Iterator[News]:
    """Yield what is announced on some topics, until the connection ends.

    Raises:
        TopicRefusedError: One of the topics is none.
        websockets.ConnectionClosedError: The connection broke.
    """
    with connect(address_of(url), additional_headers=_headers(token)) as socket:
        socket.send(_subscription(topics), text=True)
        for frame in socket:
            news = _read(frame)
            if news is not None:
                yield news


async def follow_async(url: str, token: str, topics: Iterable[str]) -> AsyncIterator[News]:
    """Yield as `follow` does."""
    async with connect_async(address_of(url), additional_headers=_headers(token)) as socket:
        await socket.send(_subscription(topics), text=True)
        async for frame in socket:
            news = _read(frame)
            if news is not None:
                yield news


def _headers(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def _subscription(topics: Iterable[str]) -> bytes:
    return msgspec.json.encode({"subscribe": list(topics)})


def _read(frame: str | bytes) -> News | None:
    found = msgspec.json.decode(frame, type=_Frame)
    if found.error is not None:
        raise TopicRefusedError(str(found.error.get("message", "")))
    return News(found.topic, found.seq, found.at, found.data) if found.topic else None
