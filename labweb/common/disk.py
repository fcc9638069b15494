"""The disk of the server: its data directory, and with the embedded servers their files too."""

from __future__ import annotations

import errno
import os
import time
from functools import lru_cache
from pathlib import Path

from django.conf import settings
from redis.exceptions import ResponseError

from labweb.domain.disk_space import DiskRoomLevel, DiskSpace, Floors

SERVER = "the server"

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
_NO_HANDLE = (errno.EMFILE, errno.ENFILE)
_DISK_FULL_STATE = "53100"
"""SQLSTATE of a PostgreSQL that finds no room, also on a machine of its own."""


def server_disk() -> DiskSpace | None:
    """Ask the system, at most once a second; None: it does not say."""
    return _asked(Path(settings.DATA_DIR), int(time.monotonic()))


@lru_cache(maxsize=1)
def _asked(folder: Path, _second: int) -> DiskSpace | None:
    try:
        found = os.statvfs(folder)
    except OSError:
        return None
    return DiskSpace(
        name=SERVER,
        free_bytes=found.f_bavail * found.f_frsize,
        total_bytes=found.f_blocks * found.f_frsize,
        is_read_only=_is_read_only(folder, found.f_flag),
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


def floors() -> Floors:
    """Return what has to be left, as the settings say."""
    return Floors(
        warn_bytes=settings.DISK_WARN_BYTES,
        warn_ratio=settings.DISK_WARN_RATIO,
        floor_bytes=settings.DISK_FLOOR_BYTES,
    )


def level() -> DiskRoomLevel:
    """Say how the server's disk stands; one that cannot be asked counts as well."""
    disk = server_disk()
    return DiskRoomLevel.OK if disk is None else disk.level(floors())


def is_about_disk(error: BaseException | None) -> bool:
    """Tell whether a failure says that a disk is full or can only be read."""
    if isinstance(error, OSError):
        return error.errno in _FULL
    if isinstance(error, ResponseError):
        return is_refusal_of_broker(error)
    return str(getattr(getattr(error, "__cause__", None), "sqlstate", "")) == _DISK_FULL_STATE


def is_refusal_of_broker(error: BaseException | None) -> bool:
    """Tell whether a Redis takes no writes, because its own disk refuses them."""
    return isinstance(error, ResponseError) and str(error).startswith("MISCONF")


def is_out_of_handles(error: BaseException | None) -> bool:
    """Tell whether this process, or the machine, may open no more files and connections."""
    return isinstance(error, OSError) and error.errno in _NO_HANDLE
