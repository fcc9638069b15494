"""A word to a host's live connection."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from uuid import UUID

from labweb.common import feed


def host_group(host_id: UUID) -> str:
    """Return the channel-layer group of a host's live connection."""
    return f"edge.{host_id.hex}"


def join_group(request_id: UUID) -> str:
    """Return the channel-layer group of a machine that waits for an answer."""
    return f"join.{request_id.hex}"


def tell_host(host_id: UUID, message: Mapping[str, Any]) -> None:
    """Send to a host's live connection; lost when there is none."""
    feed.send(host_group(host_id), message)
