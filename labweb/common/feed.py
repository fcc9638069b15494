"""Tell browsers and the twin that something changed. Never carries a fact by itself."""

from __future__ import annotations

import asyncio
import atexit
import logging
import os
import threading
import time
from queue import Full, Queue
from typing import Any

from channels.layers import get_channel_layer
from redis.exceptions import RedisError

logger = logging.getLogger(__name__)

GROUP = "feed"
"""Channel-layer group that every browser socket joins; topics are filtered there."""

MOST_WAITING = 1000
"""More announcements that Valkey has not taken are dropped."""

LAST_WORD_S = 1.0
"""How long a process that ends waits for its last announcements."""


def message(topic: str, data: dict[str, Any]) -> dict[str, Any]:
    """Build the channel-layer message for a topic."""
    return {"type": "feed.message", "topic": topic, "at": time.time(), "data": data}


def publish(topic: str, data: dict[str, Any]) -> None:
    """Announce on a topic that a row changed; call it from `on_commit`. Waits for nobody.

    A lost announcement loses nothing: browsers count and fetch again.
    """
    try:
        _speaker().put_nowait(message(topic, data))
    except Full:
        logger.warning("feed is away, %s was not announced", topic)


_started: Queue[dict[str, Any]] | None = None
_starting = threading.Lock()


def _speaker() -> Queue[dict[str, Any]]:
    """Return what the process's one speaking thread takes from, in order."""
    global _started  # noqa: PLW0603 - one for each process
    with _starting:
        if _started is None:
            _started = Queue(MOST_WAITING)
            threading.Thread(target=_speak, args=(_started,), name="feed", daemon=True).start()
        return _started


def _speak(waiting: Queue[dict[str, Any]]) -> None:
    """Send one after the other, on one event loop and so on one connection."""
    with asyncio.Runner() as runner:
        while True:
            one = waiting.get()
            try:
                runner.run(_send(one))
            except (OSError, RedisError) as error:
                logger.warning("feed is away, %s was not announced: %s", one["topic"], error)
            except Exception:
                logger.exception("%s was not announced", one["topic"])
            finally:
                waiting.task_done()


async def _send(one: dict[str, Any]) -> None:
    layer = get_channel_layer()
    if layer is not None:
        await layer.group_send(GROUP, one)


def _say_last_words() -> None:
    deadline_s = time.monotonic() + LAST_WORD_S
    while _started is not None and _started.unfinished_tasks and time.monotonic() < deadline_s:
        threading.Event().wait(0.01)


def _begin_anew() -> None:
    """Threads do not follow into the child of a fork."""
    global _started, _starting
    _started, _starting = None, threading.Lock()


atexit.register(_say_last_words)
os.register_at_fork(after_in_child=_begin_anew)
