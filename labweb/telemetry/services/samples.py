"""Writes of samples, and the announcement to whoever watches."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any
from uuid import UUID

from labweb.common import feed
from labweb.telemetry.models import Sample

KEEP_S = 24 * 3600.0
SILENT_S = 5.0
"""After so long without a sample a device counts as silent."""

_STORE_EVERY_S = 0.5
_last_heard: dict[str, float] = {}
_last_stored: dict[tuple[str, str], tuple[float, Any]] = {}


def take_in(known: set[UUID], samples: Sequence[tuple[str, str, float, Any]]) -> None:
    """Announce a frame of samples, and store at most two a second of each status.

    Args:
        known: Devices of the host that sends; samples of others are dropped.
        samples: (device id, status, wall seconds of the host, value).
    """
    by_device: dict[str, list[list[Any]]] = {}
    rows = []
    names = {str(device_id) for device_id in known}
    for device_id, status, at, value in samples:
        if device_id not in names:
            continue
        by_device.setdefault(device_id, []).append([status, at, value])
        last = _last_stored.get((device_id, status))
        if last is None or at - last[0] >= _STORE_EVERY_S or at < last[0]:
            _last_stored[(device_id, status)] = (at, value)
            rows.append(Sample(device_id=device_id, status=status, at=at, value=value))
    Sample.objects.bulk_create(rows)
    for device_id, points in by_device.items():
        _announce_return(device_id)
        feed.publish(f"telemetry:{device_id}", {"device_id": device_id, "samples": points})


def _announce_return(device_id: str) -> None:
    """Tell pages that a device speaks again, or for the first time."""
    at = time.monotonic()
    if at - _last_heard.get(device_id, -SILENT_S) >= SILENT_S:
        feed.publish("devices", {"device_id": device_id})
    _last_heard[device_id] = at


def trim() -> int:
    """Forget samples older than a day.

    Returns:
        How many rows went.
    """
    count, _ = Sample.objects.filter(at__lt=time.time() - KEEP_S).delete()
    return count
