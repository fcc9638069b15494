"""One frame to the server or from it, as JSON on the uplink's socket."""

from __future__ import annotations

import msgspec
from websockets.asyncio.client import ClientConnection

from labweb.domain.messages.frames import EdgeFrame, ServerFrame


async def receive(socket: ClientConnection) -> ServerFrame:
    """Return the next frame of the server."""
    frame: ServerFrame = msgspec.json.decode(await socket.recv(), type=ServerFrame)
    return frame


async def send(socket: ClientConnection, frame: EdgeFrame) -> None:
    """Send one frame."""
    await socket.send(msgspec.json.encode(frame).decode())
