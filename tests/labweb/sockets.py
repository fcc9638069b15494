"""Open a websocket of the ASGI application without a server between."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from asgiref.testing import ApplicationCommunicator
from django.test import Client

from labweb.api.routing import application

HOST = b"127.0.0.1:8400"
OWN = b"http://" + HOST
PATIENCE_S = 10.0


class Socket:
    """One end of a websocket."""

    def __init__(
        self,
        path: str,
        headers: list[tuple[bytes, bytes]],
        *,
        client: tuple[str, int] | None = None,
    ) -> None:
        scope = {
            "type": "websocket",
            "path": path,
            "query_string": b"",
            "headers": headers,
            "subprotocols": [],
            "client": client,
        }
        self._end: Any = ApplicationCommunicator(  # type: ignore[no-untyped-call] # asgiref is untyped
            application(), scope
        )

    async def connect(self) -> None:
        """Open; what the other side answers first is read as any frame."""
        await self._end.send_input({"type": "websocket.connect"})
        opened = await self._end.receive_output(PATIENCE_S)
        assert opened["type"] == "websocket.accept", opened

    async def refused(self) -> bool:
        """Ask to open; tell whether the handshake was refused and the other side is done."""
        await self._end.send_input({"type": "websocket.connect"})
        answer = await self._end.receive_output(PATIENCE_S)
        await self._end.send_input({"type": "websocket.disconnect", "code": 1006})
        await self._end.wait(PATIENCE_S)
        return bool(answer["type"] == "websocket.close")

    async def send_text(self, text: str) -> None:
        """Send a text frame."""
        await self._end.send_input({"type": "websocket.receive", "text": text})

    async def send_bytes(self, data: bytes) -> None:
        """Send a frame of bytes."""
        await self._end.send_input({"type": "websocket.receive", "bytes": data})

    async def receive(self) -> Any:  # noqa: ANN401 - JSON
        """Wait for one frame."""
        frame = await self._end.receive_output(PATIENCE_S)
        assert frame["type"] == "websocket.send", frame
        return json.loads(frame["text"])

    async def frame(self) -> dict[str, Any]:
        """Wait for whatever the other side does next."""
        found: dict[str, Any] = await self._end.receive_output(PATIENCE_S)
        return found

    async def ask(self, value: object) -> Any:  # noqa: ANN401 - JSON
        """Send JSON and wait for the answer."""
        await self.send_text(json.dumps(value))
        return await self.receive()

    async def closed(self) -> int:
        """Wait for the other side to close, and return its code."""
        code, _ = await self.closing()
        return code

    async def closing(self) -> tuple[int, str]:
        """Wait for the other side to close, and return its code and its reason."""
        frame = await self._end.receive_output(PATIENCE_S)
        assert frame["type"] == "websocket.close", frame
        return int(frame["code"]), str(frame.get("reason") or "")

    async def is_silent(self, for_s: float) -> bool:
        """Tell whether nothing comes for a while."""
        return bool(await self._end.receive_nothing(for_s))

    async def leave(self) -> None:
        """Close from this side and wait until the other has put everything away."""
        await self._end.send_input({"type": "websocket.disconnect", "code": 1000})
        await self._end.wait(PATIENCE_S)


@asynccontextmanager
async def a_socket(
    path: str, *, client: Client | None = None, origin: bytes | None = OWN
) -> AsyncIterator[Socket]:
    """Open a websocket with the session of a client, and close it afterwards."""
    headers = [(b"host", HOST)]
    if origin is not None:
        headers.append((b"origin", origin))
    if client is not None:
        headers.append((b"cookie", f"sessionid={client.cookies['sessionid'].value}".encode()))
    socket = Socket(path, headers)
    try:
        await socket.connect()
        yield socket
    finally:
        await socket.leave()
