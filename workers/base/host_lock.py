"""One program alone works in the folder of a host."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from labweb.domain.errors import StateError
from workers.base.config import HostConfig


def lock_host(config: HostConfig) -> int:
    """Make sure that this host runs once.

    Raises:
        StateError: It runs already.
    """
    return lock_folder(config.folder)


def lock_folder(folder: Path) -> int:
    """Make sure that one program alone works in a host's folder.

    Raises:
        StateError: Another one does.
    """
    handle = os.open(folder / "host.lock", os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as exc:
        os.close(handle)
        raise StateError(f"a host runs already in {folder}") from exc
    return handle
