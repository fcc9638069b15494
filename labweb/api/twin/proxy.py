"""The way to the twin: viser stays on the loopback interface, this is its only door."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
from collections.abc import AsyncIterator
from importlib import import_module
from types import SimpleNamespace
from typing import Any, cast
from urllib.parse import parse_qs, urlparse

import httpx
import msgspec
from channels.db import database_sync_to_async
from django.conf import settings
from django.contrib.auth import get_user
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect, StreamingHttpResponse
from rest_framework.request import Request
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException
from websockets.typing import Subprotocol

from labweb.accounts import selectors as account_selectors
from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.api.answers.twin import TwinState
from labweb.api.twin.feed import find_alive
from labweb.api.twin.viser_page import dress
from labweb.common.limits.token_buckets import Rate
from labweb.common.sockets import BoundedConsumer
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import NotFoundError
from labweb.resources import selectors as resource_selectors

logger = logging.getLogger(__name__)

VIEW_URL = "/twin/view/"
HOST = "127.0.0.1"
CLOSE_TOO_BIG = 1009
CLOSE_NOT_SIGNED_IN = 4401
CLOSE_TWIN_AWAY = 1013

CHECK_SESSION_S = 3.0
"""A socket outlives its session by no more than this and the time of one query."""

MAX_CLIENT_FRAME_BYTES = 64 * 1024
MAX_TWIN_FRAME_BYTES = 64 * 1024 * 1024
MAX_FRAMES_S = 200

POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; "
    "worker-src blob: data:; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "font-src data:; connect-src 'self' data: blob:; media-src data: blob:; "
    "frame-ancestors 'self'"
)
"""viser's page is one file with inline scripts; no other page of the server gets this."""

ALLOWED_MESSAGES = frozenset(
    {
        "ViewerCameraMessage",
        "SceneNodeClickMessage",
        "GuiUpdateMessage",
    }
)
"""Everything else a browser may say to viser is dropped: uploads, forms, and above all
`ShareUrlRequest`, which would open a public tunnel."""

_QUERY = frozenset({"initialCameraPosition", "initialCameraLookAt", "initialCameraUp", "v"})
"""viser's page also takes `websocket` and `playbackPath`: both make it run foreign content."""

_PATH = re.compile(r"(?:(?P<theme>light|dark)(?:/|$))?(?P<file>[A-Za-z0-9_-][A-Za-z0-9_.-]*)?")
_PASSED = ("content-type", "content-encoding", "content-length")


class TwinProxy(Endpoint):
    """Whether there is a twin, and where."""

    def get(self, request: Request) -> TwinState:
        """Return the twin's state; online means that it answers and that it shows now."""
        user_of(request)
        alive = find_alive()
        is_online = alive is not None and alive.is_fresh
        return TwinState(state="online" if is_online else "offline", url=VIEW_URL)


def allowed_frame(frame: bytes) -> bytes | None:
    """Return a browser's frame if it is one of the few that a viewer needs, else None.

    It is written anew from what was read, so that viser cannot read anything else in it.
    """
    try:
        message = msgspec.msgpack.decode(frame)
    except (msgspec.DecodeError, RecursionError):
        return None
    kind = message.get("type") if isinstance(message, dict) else None
    if not isinstance(kind, str) or kind not in ALLOWED_MESSAGES:
        return None
    return msgspec.msgpack.encode(message)


def may_view(user: object) -> bool:
    """Tell whether somebody may see the whole lab."""
    if not isinstance(user, User) or not user.is_active:
        return False
    try:
        root = resource_selectors.root_of(resource_selectors.the_lab())
    except NotFoundError:
        return False
    return root.id in account_selectors.granted_roots(user, Permission.VIEW)


def session_viewer(session_key: str) -> User | None:
    """Return the user of a session that is still open, if they still may see the lab."""
    store = import_module(settings.SESSION_ENGINE).SessionStore(session_key)
    user = get_user(cast(HttpRequest, SimpleNamespace(session=store)))
    return user if isinstance(user, User) and may_view(user) else None


def port_of(theme: str | None) -> int | None:
    """Return where the twin serves a theme; None while it is away."""
    alive = find_alive()
    return None if alive is None else alive.ports.get(theme or "light")


async def page(request: HttpRequest, path: str = "") -> HttpResponse | StreamingHttpResponse:
    """Serve viser's page to whoever may see the lab; 404 for every odd path."""
    if not await database_sync_to_async(may_view)(await request.auser()):
        return HttpResponse("Sign in first.\n", status=403, content_type="text/plain")
    found = _PATH.fullmatch(path)
    if found is None or set(request.GET) - _QUERY:
        return HttpResponse("Not found.\n", status=404, content_type="text/plain")
    if request.method not in {"GET", "HEAD"}:
        return HttpResponse(status=405, headers={"Allow": "GET, HEAD"})
    if request.path.removesuffix("/") == request.path and not found["file"]:
        query = request.META.get("QUERY_STRING", "")
        return HttpResponseRedirect(f"{request.path}/" + (f"?{query}" if query else ""))
    port = await database_sync_to_async(port_of)(found["theme"])
    if port is None:
        return _away()
    if not found["file"]:
        return await _fetch_page(f"http://{HOST}:{port}/")
    return await _fetch(f"http://{HOST}:{port}/{found['file']}", request)


def _away() -> HttpResponse:
    text = "The twin is away. It comes back by itself.\n"
    return HttpResponse(text, status=503, content_type="text/plain", headers={"Retry-After": "2"})


async def _fetch_page(url: str) -> HttpResponse:
    try:
        async with httpx.AsyncClient(trust_env=False, timeout=10.0) as client:
            upstream = await client.get(url, headers={"Accept-Encoding": "identity"})
    except httpx.HTTPError as error:
        logger.warning("the twin does not answer: %s", error)
        return _away()
    kind = upstream.headers.get("content-type", "text/html")
    response = HttpResponse(dress(upstream.content), status=upstream.status_code, content_type=kind)
    _guard(response)
    return response


async def _fetch(url: str, request: HttpRequest) -> HttpResponse | StreamingHttpResponse:
    client = httpx.AsyncClient(trust_env=False, timeout=10.0)
    try:
        encoding = request.headers.get("Accept-Encoding", "identity")
        headers = {"Accept-Encoding": "gzip" if "gzip" in encoding else "identity"}
        upstream = await client.send(client.build_request("GET", url, headers=headers), stream=True)
    except httpx.HTTPError as error:
        await client.aclose()
        logger.warning("the twin does not answer: %s", error)
        return _away()
    passed = {name: upstream.headers[name] for name in _PASSED if name in upstream.headers}
    response = StreamingHttpResponse(_stream(client, upstream), status=upstream.status_code)
    for name, value in passed.items():
        response[name] = value
    _guard(response)
    return response


def _guard(response: HttpResponse | StreamingHttpResponse) -> None:
    response["Content-Security-Policy"] = POLICY
    response["Cache-Control"] = "private, no-cache"


async def _stream(client: httpx.AsyncClient, upstream: httpx.Response) -> AsyncIterator[bytes]:
    try:
        async for chunk in upstream.aiter_raw():
            yield chunk
    finally:
        await upstream.aclose()
        await client.aclose()


class TwinConsumer(BoundedConsumer):
    """One browser's line to viser, watched in both directions."""

    lane = "socket"
    most_frame_bytes = MAX_CLIENT_FRAME_BYTES
    rate = Rate(per_s=MAX_FRAMES_S, burst_count=MAX_FRAMES_S)
    twin: ClientConnection | None = None
    tasks: tuple[asyncio.Task[None], ...] = ()

    async def connect(self) -> None:
        """Open a line to viser for a signed-in browser on our own page; others get 403."""
        viewer = await self._viewer() if self._is_own_page() else None
        port = None if viewer is None else await self._port()
        if viewer is None or port is None:
            await self.close()
            return
        if not await self.count_as(f"user:{viewer.pk}"):
            return
        wanted = [Subprotocol(name) for name in self.scope.get("subprotocols", ())]
        try:
            self.twin = await connect(
                f"ws://{HOST}:{port}/",
                subprotocols=wanted or None,
                max_size=MAX_TWIN_FRAME_BYTES,
                compression=None,
                proxy=None,
                open_timeout=5,
            )
        except (OSError, TimeoutError, WebSocketException) as error:
            logger.warning("the twin does not answer: %s", error)
            await self.close()
            return
        await self.accept(subprotocol=self.twin.subprotocol)
        self.tasks = tuple(asyncio.create_task(c) for c in (self._forward(), self._watch()))

    async def disconnect(self, code: int) -> None:  # noqa: ARG002 - Channels' shape
        """Close the line to viser."""
        for task in self.tasks:
            if task is not asyncio.current_task():
                task.cancel()
        if self.twin is not None:
            await self.twin.close()

    def _is_own_page(self) -> bool:
        headers = dict(self.scope["headers"])
        origin, host = (headers.get(name, b"").decode("latin-1") for name in (b"origin", b"host"))
        if not origin or urlparse(origin).netloc != host:
            return False
        query = self.scope.get("query_string", b"").decode("latin-1")
        return not set(parse_qs(query, keep_blank_values=True)) - _QUERY

    async def tell_refusal(self, code: str, text: str) -> None:
        """Say nothing: viser's page reads nothing but viser's frames."""

    async def _viewer(self) -> User | None:
        key = getattr(self.scope.get("session"), "session_key", None)
        return await self.ask(session_viewer, cast(str, key)) if key else None

    async def _port(self) -> int | None:
        theme = self.scope["url_route"]["kwargs"].get("theme")
        return await self.ask(port_of, theme)

    async def receive(self, text_data: str | None = None, bytes_data: bytes | None = None) -> None:
        """Pass on what a viewer needs and drop the rest."""
        if text_data is not None or bytes_data is None or len(bytes_data) > MAX_CLIENT_FRAME_BYTES:
            await self._end(CLOSE_TOO_BIG)
            return
        frame = allowed_frame(bytes_data)
        if frame is None:
            logger.warning("a frame that no viewer needs was dropped")
        elif self.twin is not None:
            with contextlib.suppress(WebSocketException):
                await self.twin.send(frame)

    async def _forward(self) -> None:
        if self.twin is None:
            return
        try:
            async for frame in self.twin:
                data: dict[str, Any] = (
                    {"text_data": frame} if isinstance(frame, str) else {"bytes_data": frame}
                )
                await self.send(**data)
        except WebSocketException as error:
            logger.info("the twin closed the line: %s", error)
        await self._end(CLOSE_TWIN_AWAY)

    async def _watch(self) -> None:
        while await self._viewer() is not None:
            await asyncio.sleep(CHECK_SESSION_S)
        await self._end(CLOSE_NOT_SIGNED_IN)

    async def _end(self, code: int) -> None:
        with contextlib.suppress(RuntimeError):  # the browser was quicker
            await self.close(code=code)
