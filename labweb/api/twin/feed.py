"""The lab feed: a snapshot, then deltas by number, for services that hold the token."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import logging
import time
from pathlib import Path
from secrets import compare_digest
from typing import Any

import msgspec
from django.conf import settings
from django.core.cache import cache
from django.db.utils import InterfaceError, OperationalError

from labweb.api.live import check_frame
from labweb.api.twin import snapshot
from labweb.common.feed import GROUP
from labweb.common.limits.token_buckets import Rate
from labweb.common.sockets import BoundedConsumer
from labweb.domain.errors import NotFoundError

logger = logging.getLogger(__name__)

CLOSE_BAD_FRAME = 4400
MAX_FRAME_BYTES = 16 * 1024

FLUSH_S = 0.1
"""Telemetry leaves at most ten times a second."""

BEAT_S = 0.5
REBUILD_S = 2.0
"""A lost announcement, and what only time changes, is caught up with by then."""

ALIVE_KEY = "labweb-twin-alive"
ALIVE_FOR_S = 3.0


class Alive(msgspec.Struct, frozen=True, kw_only=True):
    """What a twin says of itself each second."""

    ports: dict[str, int]
    """Theme → port on the loopback interface."""

    is_fresh: bool
    clients_count: int = 0


class FeedFrame(msgspec.Struct, frozen=True):
    """One frame of the twin: `alive` with its data, or `snapshot` to ask for one."""

    kind: str
    data: Alive | None = None


_decoder = msgspec.json.Decoder(FeedFrame)


def keep_alive(alive: Alive) -> None:
    """Remember that a twin is there, for a few seconds."""
    cache.set(ALIVE_KEY, msgspec.to_builtins(alive), ALIVE_FOR_S)


def find_alive() -> Alive | None:
    """Return what the twin last said; None when it has been silent."""
    found = cache.get(ALIVE_KEY)
    return None if found is None else msgspec.convert(found, Alive)


def holds_token(header: bytes, token_file: Path) -> bool:
    """Tell whether an Authorization header carries the service token; takes equally long."""
    try:
        token = token_file.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        logger.error("no service can follow the feed: %s", error)
        return False
    wanted = hashlib.sha256(f"Bearer {token}".encode()).digest()
    return bool(token) and compare_digest(hashlib.sha256(header).digest(), wanted)


class FeedConsumer(BoundedConsumer):
    """One twin's connection."""

    lane = "feed"
    most_frame_bytes = MAX_FRAME_BYTES
    rate = Rate(per_s=10, burst_count=100)

    async def connect(self) -> None:
        """Accept the bearer of the token; everybody else gets 403."""
        self.seq = 0
        self.known: snapshot.Body | None = None
        self.samples: dict[str, dict[str, tuple[float, Any]]] = {}
        self.is_dirty = True
        self.task: asyncio.Task[None] | None = None
        header = dict(self.scope["headers"]).get(b"authorization", b"")
        is_known = await asyncio.to_thread(holds_token, header, Path(settings.TWIN_TOKEN_FILE))
        if not is_known or self.scope.get("query_string"):
            await self.close()
            return
        await self.accept()
        await self.channel_layer.group_add(GROUP, self.channel_name)
        self.task = asyncio.create_task(self._run())

    async def disconnect(self, code: int) -> None:  # noqa: ARG002 - Channels' shape
        """Stop sending and leave the feed."""
        if self.task is None:
            return
        self.task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self.task
        await self.channel_layer.group_discard(GROUP, self.channel_name)

    async def receive(self, text_data: str | None = None, bytes_data: bytes | None = None) -> None:
        """Take a sign of life, or the wish for a snapshot."""
        code = check_frame(text_data, bytes_data, MAX_FRAME_BYTES)
        if code is not None:
            await self.close(code=code)
            return
        try:
            frame = _decoder.decode(text_data or "")
        except (msgspec.DecodeError, RecursionError):
            await self.close(code=CLOSE_BAD_FRAME)
            return
        if frame.kind == "alive" and frame.data is not None:
            await asyncio.to_thread(keep_alive, frame.data)
        elif frame.kind == "snapshot":
            self.known = None
            self.is_dirty = True
        else:
            await self.close(code=CLOSE_BAD_FRAME)

    async def feed_messages(self, message: dict[str, Any]) -> None:
        """Keep samples for the next flush; take anything else as a reason to look again."""
        for topic, data in message["told"]:
            if not topic.startswith("telemetry:"):
                self.is_dirty = True
                continue
            statuses = self.samples.setdefault(data["device_id"], {})
            for status, at, value in data["samples"]:
                statuses[status] = (at, value)

    async def _run(self) -> None:
        """Send what has gathered, ten times a second at most."""
        beat_at = rebuilt_at = 0.0
        while True:
            at = time.monotonic()
            if self.is_dirty or at - rebuilt_at >= REBUILD_S:
                self.is_dirty = False
                rebuilt_at = at
                await self._rebuild()
            if self.samples and self.known is not None:
                samples, self.samples = self.samples, {}
                await self._tell("telemetry", samples)
            if at - beat_at >= BEAT_S and self.known is not None:
                beat_at = at
                await self._tell("beat", {"at_s": time.time()})
            await asyncio.sleep(FLUSH_S)

    async def _rebuild(self) -> None:
        try:
            fresh = await self.ask(snapshot.snapshot)
        except (NotFoundError, OperationalError, InterfaceError) as error:
            logger.warning("the twin is not told anything for now: %s", error)
            return
        before, self.known = self.known, fresh
        if before is None:
            await self._tell("snapshot", fresh)
            return
        for kind, data in snapshot.changes(before, fresh):
            await self._tell(kind, data)

    async def _tell(self, kind: str, data: object) -> None:
        self.seq += 1
        await self.send(text_data=json.dumps({"seq": self.seq, "kind": kind, "data": data}))
