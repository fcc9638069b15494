"""Announcements: heard in a channel-layer group, over a connection that is kept."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from channels.layers import get_channel_layer
from channels_redis.pubsub import RedisPubSubChannelLayer  # type: ignore[import-untyped]
from pytest_django import Settings
from redis import Redis
from redis.exceptions import ConnectionError as RedisAway

from deploy.embedded.valkey import Valkey
from labweb.common import feed
from tests.services import Services

ROOT = Path(__file__).parents[3]
FORKED = """
import json, os, sys
import django
from django.conf import settings
django.setup()
settings.CHANNEL_LAYERS["default"]["CONFIG"] = json.loads(sys.argv[1])
from labweb.common import feed
feed.send("lab", {"type": "word", "word": "before"})
child = os.fork()
feed.send("lab", {"type": "word", "word": "child" if child == 0 else "parent"})
if child:
    os.waitpid(child, 0)
"""


class Own:
    """A server of one test, which it stops and starts."""

    def __init__(self, folder: Path) -> None:
        self.server = Valkey(folder, folder, durable=False)
        self.folder = folder
        self._running: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        self._running = subprocess.Popen(
            self.server.process().argv, cwd=self.folder, stdout=subprocess.DEVNULL
        )
        with Redis.from_url(self.server.url) as client:
            for _ in range(500):
                if self.server.is_ready():
                    client.ping()
                    return
                threading.Event().wait(0.02)
        raise AssertionError("the server did not start")

    def stop(self) -> None:
        if self._running is not None:
            self._running.kill()
            self._running.wait(10)
            self._running = None


@pytest.fixture
def own(services: Services, settings: Settings) -> Iterator[Own]:
    with tempfile.TemporaryDirectory(prefix="lwv", dir="/tmp") as folder:
        found = Own(Path(folder))
        config = {"hosts": [found.server.url], "prefix": "own"}
        settings.CHANNEL_LAYERS = {
            "default": {
                "BACKEND": "channels_redis.pubsub.RedisPubSubChannelLayer",
                "CONFIG": config,
            }
        }
        found.start()
        yield found
        found.stop()


async def _next(layer: Any, channel: str) -> dict[str, Any]:  # noqa: ANN401 - untyped library
    found: dict[str, Any] = await asyncio.wait_for(layer.receive(channel), 10)
    return found


async def test_a_group_of_the_layer_hears_what_is_sent(services: Services) -> None:
    layer: Any = get_channel_layer()
    channel = await layer.new_channel()
    await layer.group_add("lab", channel)
    try:
        await asyncio.to_thread(feed.send, "lab", {"type": "word", "at": 1.5, "deep": {"x": [1]}})
        assert await _next(layer, channel) == {"type": "word", "at": 1.5, "deep": {"x": [1]}}
    finally:
        await layer.flush()


def test_one_connection_serves_many_announcements(own: Own) -> None:
    with Redis.from_url(own.server.url) as client:
        before = int(client.info("stats")["total_connections_received"])
        for n in range(20):
            feed.publish("runs", {"n": n})
        after = int(client.info("stats")["total_connections_received"])
    assert after - before == 1


def test_announcements_are_heard_again_after_the_server_was_started_anew(own: Own) -> None:
    feed.publish("runs", {"n": 1})
    own.stop()
    own.start()
    with Redis.from_url(own.server.url) as client, client.pubsub() as ear:
        ear.subscribe("own__group__feed")
        ear.get_message(timeout=5)
        feed.publish("runs", {"n": 2})
        heard = ear.get_message(timeout=5)
    assert heard is not None
    layer = RedisPubSubChannelLayer()
    assert layer.deserialize(heard["data"])["told"] == [["runs", {"n": 2}]]


def test_an_announcement_that_nobody_can_carry_is_logged_and_harms_nothing(
    own: Own, caplog: pytest.LogCaptureFixture
) -> None:
    own.stop()
    feed.publish("runs", {"n": 1})
    assert "1 not announced (runs)" in caplog.text
    with pytest.raises(RedisAway):
        feed.send("lab", {"type": "word"})


async def test_a_fork_does_not_share_the_connection(own: Own) -> None:
    config = {"hosts": [own.server.url], "prefix": "own"}
    layer = RedisPubSubChannelLayer(**config)
    channel = await layer.new_channel()
    await layer.group_add("lab", channel)
    try:
        done = await asyncio.to_thread(
            subprocess.run,
            [sys.executable, "-c", FORKED, json.dumps(config)],
            cwd=ROOT,
            timeout=50,
            check=True,
        )
        words = [(await _next(layer, channel))["word"] for _ in range(3)]
    finally:
        await layer.flush()
    assert done.returncode == 0
    assert words[0] == "before"
    assert sorted(words[1:]) == ["child", "parent"]
