"""Announcements: in order, by one thread, and never in the way of who announces."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from queue import Queue
from typing import Any

import pytest
from channels.layers import get_channel_layer

from labweb.common import feed

ROOT = Path(__file__).parents[3]
COUNT = 50
ALONE = """
import django
django.setup()
from labweb.common import feed
for count in range(50):
    feed.publish("runs", {"count": count})
"""


async def heard(announce: Any) -> list[int]:  # noqa: ANN401 - a coroutine function
    """Join the feed, let something announce, and return the counts that came."""
    layer = get_channel_layer()
    assert layer is not None
    channel = await layer.new_channel()
    await layer.group_add(feed.GROUP, channel)
    await announce()
    try:
        async with asyncio.timeout(20):
            return [(await layer.receive(channel))["data"]["count"] for _ in range(COUNT)]
    finally:
        await layer.group_discard(feed.GROUP, channel)


async def test_announcements_come_in_their_order_even_from_within_an_event_loop() -> None:
    async def announce() -> None:
        for count in range(COUNT):
            feed.publish("runs", {"count": count})

    assert await heard(announce) == list(range(COUNT))
    assert [one.name for one in threading.enumerate()].count("feed") == 1


async def test_a_process_that_ends_says_its_last_words() -> None:
    async def announce() -> None:
        await asyncio.to_thread(
            subprocess.run,
            [sys.executable, "-c", ALONE],
            cwd=ROOT,
            env=dict(os.environ),
            timeout=60,
            check=True,
        )

    assert await heard(announce) == list(range(COUNT))


def test_who_announces_waits_for_nobody(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    full: Queue[dict[str, Any]] = Queue(1)
    full.put({})
    monkeypatch.setattr(feed, "_started", full)
    began_s = time.monotonic()
    feed.publish("runs", {})
    assert time.monotonic() - began_s < 5.0
    assert "was not announced" in caplog.text
    full.get()
    full.task_done()


def test_a_child_of_a_fork_speaks_with_a_thread_of_its_own() -> None:
    feed.publish("runs", {})
    child = os.fork()
    if child == 0:
        is_anew = feed._started is None
        feed.publish("runs", {})
        names = [one.name for one in threading.enumerate()]
        os._exit(0 if is_anew and "feed" in names else 1)
    assert os.waitpid(child, 0)[1] == 0
