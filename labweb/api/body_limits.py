"""What a request may bring: so many bytes, and without long silence."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

from django.conf import settings

from labweb.api.outermost_layer import Message, Receive


@dataclass(frozen=True, slots=True)
class Refused:
    """Why a request's body is not read any further."""

    status: int
    code: str
    message: str


class BoundedBody:
    """The messages of a request, up to a bound; nothing beyond it is kept anywhere."""

    refused: Refused | None = None
    """Why it broke off; what reads the body is then told that the client is gone."""

    def __init__(self, receive: Receive, scope: Any, most_bytes: int) -> None:  # noqa: ANN401 - ASGI
        self._receive = receive
        self._most_bytes = most_bytes
        self._size = 0
        self._is_whole = False
        self._check(_declared(scope))

    async def __call__(self) -> Message:
        """Return the next message."""
        if self._is_whole:
            return await self._receive()
        if self.refused is not None:
            return {"type": "http.disconnect"}
        try:
            async with asyncio.timeout(settings.RECEIVE_WITHIN_S):
                message = await self._receive()
        except TimeoutError:
            text = f"nothing came for {settings.RECEIVE_WITHIN_S:g} s: send the request again"
            self.refused = Refused(408, code="http.too_slow", message=text)
            return {"type": "http.disconnect"}
        self._size += len(message.get("body", b""))
        self._check(self._size)
        if self.refused is not None:
            return {"type": "http.disconnect"}
        self._is_whole = not message.get("more_body", False)
        return message

    def _check(self, size: int) -> None:
        if size > self._most_bytes:
            text = f"a request to this address may have {self._most_bytes} bytes"
            self.refused = Refused(413, code="http.too_large", message=text)


def _declared(scope: Any) -> int:  # noqa: ANN401 - ASGI
    length = dict(scope["headers"]).get(b"content-length", b"")
    return int(length) if length.isdigit() and len(length) < 19 else 0
