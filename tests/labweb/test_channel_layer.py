"""Labs that share a Redis under different database numbers do not hear each other."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from channels_redis.pubsub import RedisPubSubChannelLayer  # type: ignore[import-untyped]

from tests.services import Services

ROOT = Path(__file__).parents[2]
PROGRAM = """
import json
from labweb.settings import local
print(json.dumps(local.CHANNEL_LAYERS["default"]["CONFIG"]))
"""


def config_of(redis_url: str) -> dict[str, Any]:
    """Read the channel layer's settings as a process of a lab on that Redis has them."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=ROOT,
        env=os.environ | {"REDIS_URL": redis_url},
        capture_output=True,
        text=True,
        timeout=50,
        check=True,
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


async def heard(config: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """Send one word from each of two labs, and return what the first one hears."""
    layer, stranger = RedisPubSubChannelLayer(**config), RedisPubSubChannelLayer(**other)
    words: list[str] = []
    try:
        channel = await layer.new_channel()
        await layer.group_add("lab", channel)
        await stranger.group_send("lab", {"type": "word", "word": "strange"})
        await layer.group_send("lab", {"type": "word", "word": "own"})
        while "own" not in words:
            words.append((await asyncio.wait_for(layer.receive(channel), 10))["word"])
    finally:
        await layer.flush()
        await stranger.flush()
    return words


@pytest.mark.parametrize(("number", "expected"), [(1, ["own"]), (0, ["strange", "own"])])
async def test_a_lab_hears_its_own_database_number_alone(
    services: Services, number: int, expected: list[str]
) -> None:
    url = os.environ["REDIS_URL"]
    if url.startswith("unix://"):
        one, other = url, url.replace("db=0", f"db={number}")
    else:
        server = url.rpartition("/")[0]
        one, other = f"{server}/0", f"{server}/{number}"
    assert await heard(config_of(one), config_of(other)) == expected
