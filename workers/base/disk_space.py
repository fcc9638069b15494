"""How much room the host's disk has: told to the server, and asked before a write is given up."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import TypedDict

LEAST_BYTES = 2**20
"""With less, a write that was refused was refused for want of room."""


class MeasuredDiskSpace(TypedDict):
    """What a sign of life says of the disk."""

    disk_free_bytes: int
    disk_total_bytes: int
    is_disk_read_only: bool


def disk_space_of(folder: Path) -> MeasuredDiskSpace:
    """Ask the system.

    Raises:
        OSError: It does not say.
    """
    found = os.statvfs(folder)
    return MeasuredDiskSpace(
        disk_free_bytes=found.f_bavail * found.f_frsize,
        disk_total_bytes=found.f_blocks * found.f_frsize,
        is_disk_read_only=_is_read_only(folder, found.f_flag),
    )


def _is_read_only(folder: Path, flags: int) -> bool:
    """Say whether nothing can be written: one that failed may say so to writes alone."""
    if flags & os.ST_RDONLY:
        return True
    try:
        os.utime(folder)
    except OSError as error:
        return error.errno == errno.EROFS
    return False


def is_short(folder: Path) -> bool:
    """Say whether a disk takes nothing now, which a person can mend while a process waits."""
    try:
        told = disk_space_of(folder)
    except OSError:
        return False
    return told["is_disk_read_only"] or told["disk_free_bytes"] < LEAST_BYTES
