"""The door for edge hosts: TLS that ends here, and nothing behind it but the hosts' websockets.

A machine that joins comes without a certificate and may ask; a host comes with the one that
the lab's authority gave it. The connection's certificate is handed to the consumer, which
compares it with what is known of the host.

Source:
    TLS 1.3, RFC 8446, with a certificate on both sides.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, cast

from channels.routing import URLRouter
from django.urls import re_path
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from labweb.api.live import NoSuchConsumer
from labweb.enrollment.live import JoinConsumer
from labweb.fleet.live import EdgeConsumer

_Send = Callable[[dict[str, Any]], Awaitable[None]]


def application() -> Any:  # noqa: ANN401 - ASGI
    """Build what stands behind the door: two websockets, and 404 for every request."""
    routes: list[Any] = [
        _route(r"^ws/edge/v1/$", EdgeConsumer.as_asgi()),
        _route(r"^ws/edge/v1/join$", JoinConsumer.as_asgi()),
        _route(r"", NoSuchConsumer.as_asgi()),
    ]
    sockets = URLRouter(routes)

    async def answer(scope: Any, receive: Any, send: _Send) -> None:  # noqa: ANN401 - ASGI
        if scope["type"] == "websocket":
            await sockets(scope, receive, cast("Any", send))
        elif scope["type"] == "http":
            await send({"type": "http.response.start", "status": 404, "headers": []})
            await send({"type": "http.response.body", "body": b""})

    return answer


def _route(pattern: str, consumer: Any) -> Any:  # noqa: ANN401 - Django's types know no ASGI
    return re_path(pattern, consumer)


LONGEST_STRANGER_BYTES = 64 * 1024
"""Of a message from a machine without a certificate; a longer one is not even kept."""


class WithCertificate(WebSocketsSansIOProtocol):
    """A websocket that tells the application with which certificate it was opened."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Bound what a machine may send that has shown no certificate."""
        super().connection_made(transport)
        shown = transport.get_extra_info("ssl_object")
        if shown is None or shown.getpeercert(binary_form=True) is None:
            self.conn.max_message_size = LONGEST_STRANGER_BYTES

    async def run_asgi(self) -> None:
        """Put the DER form of the verified certificate into the scope; None: there is none."""
        shown = self.transport.get_extra_info("ssl_object")
        certificate = None if shown is None else shown.getpeercert(binary_form=True)
        cast("dict[str, Any]", self.scope)["certificate"] = certificate
        await super().run_asgi()
