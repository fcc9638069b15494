"""What every websocket of the server has: bounds of frames and of their rate, and a lane."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import time
from collections import Counter
from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar, ParamSpec, TypeVar
from uuid import uuid4

from channels.exceptions import StopConsumer
from channels.generic.websocket import AsyncWebsocketConsumer
from django.conf import settings

from labweb.common.limits.concurrency import on_lane
from labweb.common.limits.token_buckets import Buckets, Rate

logger = logging.getLogger(__name__)

P = ParamSpec("P")
T = TypeVar("T")

CLOSE_TOO_BIG = 1009
CLOSE_TOO_FAST = 4429
"""Too many frames or connections: connect again later."""

_LONGEST_PAUSE_S = 1.0
"""A frame too many is answered after a pause: meanwhile nothing more is read of the socket."""

_FORGET_AFTER_S = 30.0

_open: Counter[str] = Counter()
"""Sockets that are open now, by kind and by who has them."""


class BoundedConsumer(AsyncWebsocketConsumer):
    """A websocket that cannot ask for more than its share.

    Frames are counted by socket until `count_as` says whose they are; then all sockets of that
    name share one bucket. A frame too many is not read: the other side is told, and after
    `most_strikes` of them within half a minute the socket is closed with 4429.
    """

    lane: ClassVar[str]
    """Lane on whose threads it asks the database."""

    most_frame_bytes: ClassVar[int]
    rate: ClassVar[Rate]
    """Frames; an unit may also be what a frame asks for."""

    connect_rate: ClassVar[Rate] = Rate(per_s=5, burst_count=60)
    """Connections from one address."""

    most_open: ClassVar[int] = 24
    """Sockets of this kind that one name may have open."""

    most_strikes: ClassVar[int] = 10

    def __init__(self, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - Channels' shape
        super().__init__(*args, **kwargs)
        self.counted_as = f"socket:{uuid4()}"
        self.is_patient = False
        """A frame too many waits and is then read: of one that has proved who it is."""

        self._is_opened = self._is_counted = False
        self._strikes, self._struck_at = 0, 0.0

    async def websocket_connect(self, message: Any) -> None:  # noqa: ANN401 - Channels' shape
        """Open, unless the address connects too often."""
        client = self.scope.get("client")
        wait_s = 0.0
        if client:
            buckets = _buckets(f"connections of {type(self).__name__}", self.connect_rate)
            wait_s = buckets.take(str(client[0]))
        if wait_s:
            await self.accept()
            text = f"this address connects too often: wait {math.ceil(wait_s)} s"
            await self.refuse("feed.too_fast", text)
            return
        self._is_opened = True
        await super().websocket_connect(message)

    async def websocket_disconnect(self, message: Any) -> None:  # noqa: ANN401 - Channels' shape
        """Close, and count the socket no more."""
        if self._is_counted:
            self._is_counted = False
            _open[self._kind_and_name()] -= 1
        if not self._is_opened:
            raise StopConsumer
        await super().websocket_disconnect(message)

    async def websocket_receive(self, message: Any) -> None:  # noqa: ANN401 - Channels' shape
        """Take a frame, if it is neither too large nor one too many."""
        text, data = message.get("text"), message.get("bytes")
        size = len(data or b"") if text is None else len(text.encode(errors="replace"))
        if size > self.most_frame_bytes:
            await self.close(code=CLOSE_TOO_BIG)
        elif self._is_opened and await self.may_take(1):
            await super().websocket_receive(message)

    async def count_as(self, name: str) -> bool:
        """Count the socket to a name from now on; False: it has too many, and is closed."""
        self.counted_as = name
        if _open[self._kind_and_name()] >= self.most_open:
            text = f"more than {self.most_open} connections of this kind are open: close some"
            await self.refuse("feed.too_many_sockets", text)
            return False
        _open[self._kind_and_name()] += 1
        self._is_counted = True
        return True

    async def may_take(self, cost: float) -> bool:
        """Tell whether so much more may be asked for now; else the other side was told."""
        wait_s = _buckets(f"frames of {type(self).__name__}", self.rate).take(self.counted_as, cost)
        if wait_s and self.is_patient:
            await asyncio.sleep(wait_s)
            return True
        if wait_s:
            await self._strike(wait_s)
        return not wait_s

    async def _strike(self, wait_s: float) -> None:
        """Tell that a frame was one too many, and pause; or close after too many of these."""
        at = time.monotonic()
        self._strikes = self._strikes + 1 if at - self._struck_at < _FORGET_AFTER_S else 1
        self._struck_at = at
        if self._strikes > self.most_strikes:
            logger.warning("%s is closed: it sends too fast", self.counted_as)
            await self.refuse(
                "feed.too_fast", "frames come faster than they may: connect again later"
            )
            return
        text = f"frames come faster than they may: this one was not read; wait {wait_s:.1f} s"
        await self.tell_refusal("feed.too_fast", text)
        await asyncio.sleep(min(wait_s, _LONGEST_PAUSE_S))

    async def refuse(self, code: str, text: str) -> None:
        """Say why, and close."""
        await self.tell_refusal(code, text)
        await self.close(code=CLOSE_TOO_FAST, reason=code)

    async def tell_refusal(self, code: str, text: str) -> None:
        """Send why something was refused, in the form that this kind of socket has."""
        await self.send(text_data=json.dumps({"error": {"code": code, "message": text}}))

    async def ask(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Call a function that asks the database, on this socket's lane."""
        return await on_lane(self.lane, function)(*args, **kwargs)

    def _kind_and_name(self) -> str:
        return f"{type(self).__name__} {self.counted_as}"


@cache
def _buckets(_name: str, rate: Rate) -> Buckets:
    return Buckets(rate.times(settings.RATE_TIMES))
