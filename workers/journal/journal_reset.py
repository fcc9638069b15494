"""Set a journal aside, so that the host begins a new one."""

from __future__ import annotations

import os
import time
from pathlib import Path

from workers.base.config import HostConfig
from workers.base.host_lock import lock_host


def reset_journal(config: HostConfig) -> Path:
    """Set the journal aside and let the host begin a new one, after a person took stock.

    Effect:
        None on matter. The server sees another journal and asks for an inventory.

    Raises:
        StateError: The host runs.
    """
    handle = lock_host(config)
    try:
        return set_journal_aside(config.folder)
    finally:
        os.close(handle)


def set_journal_aside(folder: Path) -> Path:
    """Put what there is of a journal into a folder of its own; the caller holds the lock."""
    aside = folder / f"journal-until-{int(time.time())}"
    aside.mkdir(mode=0o700)
    for path in folder.glob("journal.*"):
        path.rename(aside / path.name)
    return aside
