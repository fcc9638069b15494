"""Tell browsers and the twin that something changed. Never carries a fact by itself."""

from __future__ import annotations

import logging
import time
from typing import Any

from asgiref.sync import async_to_sync
from channels.layers import get_channel_layer

logger = logging.getLogger(__name__)

GROUP = "feed"
"""Channel-layer group that every browser socket joins; topics are filtered there."""


def message(topic: str, data: dict[str, Any]) -> dict[str, Any]:
    """Build the channel-layer message for a topic."""
    return {"type": "feed.message", "topic": topic, "at": time.time(), "data": data}


def publish(topic: str, data: dict[str, Any]) -> None:
    """Announce on a topic that a row changed; call it from `on_commit`.

    A lost announcement loses nothing: browsers count and fetch again.
    """
    layer = get_channel_layer()
    if layer is None:
        return
    try:
        async_to_sync(layer.group_send)(GROUP, message(topic, data))
    except OSError as error:
        logger.warning("feed is away, %s was not announced: %s", topic, error)
