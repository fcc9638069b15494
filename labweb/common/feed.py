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
_MOST_NAMED = 3


def publish(topic: str, data: Mapping[str, Any]) -> None:
    """Announce on a topic that a row changed; call it from `on_commit`.

    A lost announcement loses nothing: browsers count and fetch again.
    """
    publish_all([(topic, data)])


def publish_all(told: Sequence[tuple[str, Mapping[str, Any]]]) -> None:
    """Announce on many topics in one message, in order; a lost one loses nothing.

    Every tab hears all of it and most want little of it: one message is decoded once.
    """
    if not told:
        return
    try:
        send(GROUP, {"type": "feed.messages", "at": time.time(), "told": told})
    except RedisError as error:
        topics = ", ".join(topic for topic, _ in told[:_MOST_NAMED])
        logger.warning("feed is away, %d not announced (%s): %s", len(told), topics, error)


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
