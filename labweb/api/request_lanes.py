"""How a request goes from the event loop to Django: known, counted, and in a lane of its own."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any, TypeVar

from asgiref.sync import sync_to_async
from django.conf import settings
from django.core.handlers.asgi import ASGIHandler
from django.db import InterfaceError, OperationalError
from django.http import HttpRequest, JsonResponse
from django.http.response import HttpResponseBase

from labweb.api import rate_limits
from labweb.api.access.callers import Callers, caller_of_session, caller_of_token, stranger_of
from labweb.api.access.token_sign_in import bearer_of
from labweb.api.body_limits import BoundedBody
from labweb.api.errors import refusal
from labweb.api.outermost_layer import Receive, Scope, Send
from labweb.api.rate_limits import STREAMS, TERMS, Pace
from labweb.common.limits.concurrency import FullError, Lane, LaneTicket, give_back_connection
from labweb.common.limits.token_buckets import Buckets

logger = logging.getLogger(__name__)

_caller: ContextVar[str] = ContextVar("caller", default="")
"""Who is being answered; empty: the answer takes no place of those that are sent in parts.

The task that calls the view also sends the answer."""

_FULL_AGAIN_S = 2

A = TypeVar("A")
T = TypeVar("T")
Chain = Callable[[HttpRequest], HttpResponseBase]


class Handler(ASGIHandler):
    """Django's handler with middleware and view on one thread, from the first to the last.

    Django's own takes each part of the middleware to the thread and back by itself; all of ours
    is synchronous but for answers that stream, which the event loop sends in either case. A
    request has a place in its lane, and a connection to the database, while it is on its thread
    and no longer: neither is held while a body comes in or an answer goes out.
    """

    def __init__(self) -> None:
        self._lanes = {
            lane: Lane(terms.room(settings.LANES[lane]))
            for terms in TERMS.values()
            if (lane := terms.lane)
        }
        self._who = Lane(TERMS[Pace.QUICK].room(settings.LANES["who"]))
        self._streams = Lane(STREAMS)
        self._buckets = {
            pace: Buckets(terms.rate.times(settings.RATE_TIMES)) for pace, terms in TERMS.items()
        }
        self._callers = Callers()
        super().__init__()

    def load_middleware(self, is_async: bool = False) -> None:  # noqa: FBT001, FBT002 - Django's shape
        """Build the chain as for WSGI, and go over to its thread once."""
        del is_async
        super().load_middleware(is_async=False)
        chain: Any = self._middleware_chain

        async def admit(request: HttpRequest) -> HttpResponseBase:
            return await self._admit(request, chain)

        self._middleware_chain: Any = admit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request whose body is bounded by what its endpoint takes."""
        body = BoundedBody(receive, scope, rate_limits.find(scope["path"]).most_body_bytes)
        await super().__call__(scope, body, send)
        if body.refused is not None:
            answer = refusal(body.refused.status, body.refused.code, body.refused.message)
            answer["Connection"] = "close"  # or the rest of it would be read
            await super().send_response(answer, send)

    async def _admit(self, request: HttpRequest, chain: Chain) -> HttpResponseBase:
        """Find who calls, and whether it is their turn; then go through Django."""
        pace = rate_limits.find(request.path_info).pace(request.method or "")
        terms = TERMS[pace]
        try:
            caller = await self._find_caller(request, pace)
            wait_s = self._buckets[pace].take(caller)
            if wait_s:
                logger.warning("%s asks too often for %s", caller, request.path_info)
                return _too_often(wait_s)
            if not terms.lane:
                return await sync_to_async(chain)(request)
            _caller.set(caller)
            return await _through(self._lanes[terms.lane], caller, chain, request)
        except FullError as full:
            logger.warning("no place in lane %r for %s", terms.lane, request.path_info)
            return _too_many() if full.is_own else _busy()

    async def _find_caller(self, request: HttpRequest, pace: Pace) -> str:
        """Return as whom a request is counted: by its token, its session or its address."""
        stranger = stranger_of(request)
        secret = bearer_of(str(request.headers.get("Authorization", "")))
        key = secret or request.COOKIES.get(settings.SESSION_COOKIE_NAME, "")
        if not key or not TERMS[pace].lane:
            return stranger
        find = caller_of_token if secret else caller_of_session
        known = self._callers.find(key)
        if known is None:
            # Whoever stops the lab does not queue behind sessions that somebody made up.
            lane = self._lanes["stop"] if pace is Pace.STOP else self._who
            try:
                known = await _through(lane, stranger, find, key)
            except (OperationalError, InterfaceError):
                return stranger  # Django then says that the database is away
            self._callers.keep(key, known)
        return known or stranger

    async def send_response(self, response: HttpResponseBase, send: Send) -> None:
        """Send an answer; of those that are sent block by block only so many at a time."""
        if not response.streaming or not _caller.get():
            await super().send_response(response, send)
            return
        caller = _caller.get()
        try:
            await self._streams.enter(caller)
        except FullError as full:
            await super().send_response(_too_many() if full.is_own else _busy(), send)
            return
        try:
            await super().send_response(response, send)
        finally:
            self._streams.leave(caller)


async def _through(lane: Lane, name: str, function: Callable[[A], T], argument: A) -> T:
    """Call a function on the request's thread, with a place in a lane.

    Raises:
        FullError: There is no place in time; it was not called.
    """
    await lane.enter(name)
    ticket = LaneTicket(lane, name)
    try:
        return await sync_to_async(_on_thread)(ticket, function, argument)
    finally:
        ticket.drop()


def _on_thread(ticket: LaneTicket, function: Callable[[A], T], argument: A) -> T:
    if not ticket.begin():
        raise FullError(is_own=True)
    try:
        return function(argument)
    finally:
        give_back_connection()
        ticket.end()


def _too_often(wait_s: float) -> JsonResponse:
    seconds = max(1, math.ceil(wait_s))
    text = f"you send requests faster than one user may: wait {seconds} s"
    return refusal(429, "http.throttled", text, retry_after_s=seconds)


def _too_many() -> JsonResponse:
    text = "too many of your requests are being answered: wait until one has ended"
    return refusal(429, "http.too_many", text, retry_after_s=_FULL_AGAIN_S)


def _busy() -> JsonResponse:
    text = "the server is busy with other requests of this kind: try again in a moment"
    return refusal(503, "http.busy", text, retry_after_s=_FULL_AGAIN_S)
