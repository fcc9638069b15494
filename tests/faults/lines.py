"""A bad line in a thread of the test, between two other processes."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from fixtures.network.proxy import Proxy
from fixtures.network.toxics import parse_toxic


class Line:
    """What a test does to one line, from any thread but its own."""

    def __init__(self, proxy: Proxy, loop: asyncio.AbstractEventLoop) -> None:
        self._proxy = proxy
        self._loop = loop
        self.host, self.port = self._do(proxy.open())

    def _do(self, work: Coroutine[Any, Any, Any]) -> Any:  # noqa: ANN401 - what the work gives
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(10)

    def add(self, kind: str, **fields: Any) -> None:  # noqa: ANN401 - as in JSON
        """Make it worse."""
        toxic, way = parse_toxic({"kind": kind, **fields})
        self._do(self._proxy.add(toxic, way))

    def mend(self) -> None:
        """Make it sound."""
        self._do(self._proxy.remove())

    def state(self) -> dict[str, Any]:
        return self._proxy.state()

    def through(self, url: str) -> str:
        """Give an address with this line in place of the server."""
        parts = urlsplit(url)
        login, at, _ = parts.netloc.rpartition("@")
        return parts._replace(netloc=f"{login}{at}{self.host}:{self.port}").geturl()

    def close(self) -> None:
        self._do(self._proxy.close())


@contextmanager
def a_line_to(url: str, *, seed: int = 0) -> Iterator[Line]:
    """Put a line in front of the server of that address."""
    parts = urlsplit(url)
    assert parts.hostname is not None
    assert parts.port is not None
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name="line", daemon=True)
    thread.start()
    try:
        line = Line(Proxy((parts.hostname, parts.port), seed=seed), loop)
        try:
            yield line
        finally:
            line.close()
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join(5)
        loop.close()
