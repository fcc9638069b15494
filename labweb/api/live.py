"""The browser's websocket: one per tab, topics by subscription."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import Iterable
from importlib import import_module
from types import SimpleNamespace
from typing import Any, cast
from urllib.parse import urlparse
from uuid import UUID

from channels.generic.websocket import AsyncWebsocketConsumer
from django.conf import settings
from django.contrib.auth import get_user
from django.http import HttpRequest
from django.http.request import split_domain_port, validate_host

from labweb.accounts.selectors import User
from labweb.api.access.token_sign_in import bearer_of, caller_of, token_of
from labweb.api.json_bodies import finite, refuse_constant, whole
from labweb.common.feed import GROUP
from labweb.common.limits.token_buckets import Rate
from labweb.common.sockets import CLOSE_TOO_BIG, BoundedConsumer
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import NotFoundError
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors as run_selectors

CLOSE_NOT_SIGNED_IN = 4401
CLOSE_BAD_ORIGIN = 4403
CLOSE_BAD_FRAME = 4400
MAX_FRAME_BYTES = 64 * 1024
MAX_TOPICS = 200

OPEN_TOPICS = frozenset(
    {
        *("lab", "runs", "approvals", "hosts", "devices"),
        *("drivers", "tryouts", "events", "workflows"),
    }
)

CHECK_EVERY_S = 3.0
"""A socket outlives its session by this much at most."""


def check_frame(text: str | None, data: bytes | None, most_bytes: int) -> int | None:
    """Return the code to close with when a frame is too large, or is bytes; None: it is text."""
    raw = data if text is None else text.encode(errors="replace")
    if raw is not None and len(raw) > most_bytes:
        return CLOSE_TOO_BIG
    return CLOSE_BAD_FRAME if text is None else None


class NoSuchConsumer(AsyncWebsocketConsumer):
    """Refuses a websocket at an address that is none: the handshake gets 403."""

    async def connect(self) -> None:
        """Close before anything was accepted."""
        await self.close()


class BrowserConsumer(BoundedConsumer):
    """Forwards announcements on the topics a tab asked for, each with its own count."""

    lane = "socket"
    most_frame_bytes = MAX_FRAME_BYTES
    rate = Rate(per_s=60, burst_count=600)
    """Frames and topics of one user, on all tabs: a page opens with as many as it shows."""

    topics: frozenset[str] = frozenset()
    user: User | None = None
    secret: str | None = None
    """Of the access token that was shown; None: whoever asks has a session."""

    caller: str = ""
    """Under which name frames and topics are counted."""

    watch: asyncio.Task[None] | None = None

    async def connect(self) -> None:
        """Accept a signed-in user from our own origin, or a program with an access token.

        A browser cannot send the header of a token, so that no foreign page can.
        """
        self.seq: Counter[str] = Counter()
        await self.accept()
        headers = dict(self.scope["headers"])
        self.secret = bearer_of(headers.get(b"authorization", b"").decode("latin-1"))
        if self.secret is None and not self._has_own_origin():
            await self.close(code=CLOSE_BAD_ORIGIN)
        elif not await self._is_signed_in():
            await self.close(code=CLOSE_NOT_SIGNED_IN)
        elif self.user is not None and await self.count_as(self.caller):
            await self.channel_layer.group_add(GROUP, self.channel_name)
            self.watch = asyncio.create_task(self._watch())

    async def disconnect(self, code: int) -> None:  # noqa: ARG002 - Channels' shape
        """Leave the feed."""
        if self.watch is not None:
            self.watch.cancel()
        await self.channel_layer.group_discard(GROUP, self.channel_name)

    def _has_own_origin(self) -> bool:
        headers = dict(self.scope["headers"])
        origin = headers.get(b"origin", b"").decode()
        host = headers.get(b"host", b"").decode()
        name = split_domain_port(host)[0]
        is_ours = bool(name) and validate_host(name, settings.ALLOWED_HOSTS)
        return is_ours and bool(origin) and urlparse(origin).netloc == host

    async def _is_signed_in(self) -> bool:
        """Read session or token anew: it may have ended since the socket was opened."""
        if self.secret is not None:
            found = await self.ask(_holder, self.secret)
            self.user, self.caller = found or (None, "")
            return self.user is not None
        key = self.scope["session"].session_key
        self.user = await self.ask(_member, key) if key else None
        self.caller = "" if self.user is None else f"user:{self.user.pk}"
        return self.user is not None

    async def _watch(self) -> None:
        """Close within seconds of the session's end, and drop what may not be seen any more."""
        while True:
            await asyncio.sleep(CHECK_EVERY_S)
            if not await self._is_signed_in() or self.user is None:
                await self.close(code=CLOSE_NOT_SIGNED_IN)
                return
            checked = self.topics
            # Only what was checked may go: the tab may have asked for more in the meantime.
            lost = checked - await self.ask(_allowed, self.user, checked)
            self.topics -= lost

    async def receive(self, text_data: str | None = None, bytes_data: bytes | None = None) -> None:
        """Take `{"subscribe": [...]}`, `{"unsubscribe": [...]}` or `{"ping": n}`."""
        code = check_frame(text_data, bytes_data, MAX_FRAME_BYTES)
        if code is not None:
            await self.close(code=code)
            return
        try:
            frame = json.loads(
                text_data or "", parse_constant=refuse_constant, parse_float=finite, parse_int=whole
            )
            wanted = {str(topic) for topic in frame.get("subscribe", [])}
            left = {str(topic) for topic in frame.get("unsubscribe", [])}
        except (ValueError, AttributeError, TypeError, RecursionError):
            await self.close(code=CLOSE_BAD_FRAME)
            return
        if "ping" in frame:
            await self._send({"pong": frame["ping"]})
        if self.user is None or len(self.topics | wanted) > MAX_TOPICS:
            error = {"code": "feed.too_many", "message": f"at most {MAX_TOPICS} topics"}
            await self._send({"error": error})
            return
        if not await self.may_take(len(wanted)):
            return
        user = self.user
        allowed = await self.ask(_allowed, user, wanted) if wanted else frozenset[str]()
        # A topic that is gone silences none that was asked for beside it.
        self.topics = (self.topics | allowed) - left
        unknown = sorted(wanted - allowed)
        if unknown:
            error = {"code": "feed.unknown_topic", "message": f"no topic {', '.join(unknown)}"}
            await self._send({"error": error})

    async def feed_messages(self, message: dict[str, Any]) -> None:
        """Forward what was announced on the topics of this tab, each by itself."""
        for topic, data in message["told"]:
            if topic in self.topics:
                self.seq[topic] += 1
                seq = self.seq[topic]
                await self._send({"topic": topic, "seq": seq, "at": message["at"], "data": data})

    async def _send(self, value: dict[str, Any]) -> None:
        await self.send(text_data=json.dumps(value))


def _member(session_key: str) -> User | None:
    """Return the user of a session, if there is one who may hear of anything."""
    store = import_module(settings.SESSION_ENGINE).SessionStore(session_key)
    user = get_user(cast("HttpRequest", SimpleNamespace(session=store)))
    return user if isinstance(user, User) and _allowed(user, OPEN_TOPICS) else None


def _holder(secret: str) -> tuple[User, str] | None:
    """Return the owner of an access token, if they may hear of anything, and its caller's name."""
    token = token_of(secret)
    if token is None or not _allowed(token.user, OPEN_TOPICS):
        return None
    return token.user, caller_of(token)


def _allowed(user: User, topics: Iterable[str]) -> frozenset[str]:
    """Return those of the topics that the user may hear of."""
    seen = resource_selectors.allowed_ids(user, Permission.VIEW)
    return frozenset(topic for topic in topics if seen and _may_hear(topic, seen))


def _may_hear(topic: str, seen: set[UUID]) -> bool:
    if topic in OPEN_TOPICS:
        return True
    kind, _, text = topic.partition(":")
    try:
        ident = UUID(text)
        if kind == "telemetry":
            return bool(enrollment_selectors.find_device(ident, seen))
        if kind == "run":
            lab = run_selectors.find_run(ident).lab
            return run_selectors.visible_runs(lab, seen).filter(pk=ident).exists()
    except (ValueError, NotFoundError):
        return False
    return False
