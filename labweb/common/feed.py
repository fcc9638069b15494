"""Tell browsers and the twin that something changed. Never carries a fact by itself."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from channels.layers import get_channel_layer
from django.conf import settings
from redis import Redis
from redis.backoff import NoBackoff
from redis.exceptions import RedisError
from redis.retry import Retry

logger = logging.getLogger(__name__)

GROUP = "feed"
"""Channel-layer group that every browser socket joins; topics are filtered there."""

_SILENT_S = 2.0


def message(topic: str, data: dict[str, Any]) -> dict[str, Any]:
    """Build the channel-layer message for a topic."""
    return {"type": "feed.message", "topic": topic, "at": time.time(), "data": data}


def publish(topic: str, data: dict[str, Any]) -> None:
    """Announce on a topic that a row changed; call it from `on_commit`.

    A lost announcement loses nothing: browsers count and fetch again.
    """
    try:
        send(GROUP, message(topic, data))
    except RedisError as error:
        logger.warning("feed is away, %s was not announced: %s", topic, error)


def publish_all(told: Sequence[tuple[str, dict[str, Any]]]) -> None:
    """Announce on many topics in one exchange, in order; a lost announcement loses nothing."""
    if not told:
        return
    layer: Any = get_channel_layer()
    config: Any = settings.CHANNEL_LAYERS["default"]["CONFIG"]
    channel = f"{config['prefix']}__group__{GROUP}"
    try:
        pipe = _server(config["hosts"][0]).pipeline(transaction=False)
        for topic, data in told:
            pipe.publish(channel, layer.serialize(message(topic, data)))
        pipe.execute()
    except RedisError as error:
        logger.warning("feed is away, %d topics were not announced: %s", len(told), error)


def send(group: str, told: Mapping[str, Any]) -> None:
    """Send to everybody in a channel-layer group.

    The layer itself would open an event loop and a connection for each word from code that
    is not asynchronous. So this publishes its bytes on the group's channel, as its
    `group_send` does, over a connection that is kept.

    Raises:
        redis.exceptions.RedisError: The server is away. Nobody hears it.
    """
    layer: Any = get_channel_layer()
    config: Any = settings.CHANNEL_LAYERS["default"]["CONFIG"]
    channel = f"{config['prefix']}__group__{group}"
    _server(config["hosts"][0]).publish(channel, layer.serialize(dict(told)))


@cache
def _server(url: str) -> Redis:
    """Return the client of this process: a connection for each thread at a time, and for a fork.

    A connection that has gone stale is opened anew, once and at once: somebody waits.
    """
    return Redis.from_url(
        url,
        retry=Retry(NoBackoff(), 1),
        socket_connect_timeout=_SILENT_S,
        socket_timeout=_SILENT_S,
    )
