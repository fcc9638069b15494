"""What hosts said last of their disks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from labweb.domain.disk_space import DiskSpace
from labweb.enrollment.models import EdgeHost


def disk_of(name: str, heartbeat: Mapping[str, Any]) -> DiskSpace | None:
    """Return the disk of a host by its last sign of life; None: it has not told."""
    free = heartbeat.get("disk_free_bytes")
    if not isinstance(free, int):
        return None
    return DiskSpace(
        name=name,
        free_bytes=free,
        total_bytes=int(heartbeat.get("disk_total_bytes", 0)),
        is_read_only=bool(heartbeat.get("is_disk_read_only", False)),
    )


def disks_of(hosts: Iterable[EdgeHost]) -> list[tuple[EdgeHost, DiskSpace]]:
    """Return each host that has told of its disk, with it."""
    told = ((host, disk_of(host.name, host.heartbeat)) for host in hosts)
    return [(host, disk) for host, disk in told if disk is not None]
