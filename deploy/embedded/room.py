"""How much room the disk under a data directory has, and what is said about it.

The same levels as the page shows, by the same variables; `labweb.domain.disk_space` has the rule
for the server and its hosts.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

from deploy.embedded.console import Console

WARN_MB, WARN_PERCENT, FLOOR_MB = (
    "LABWEB_DISK_WARN_MB",
    "LABWEB_DISK_WARN_PERCENT",
    "LABWEB_DISK_FLOOR_MB",
)
DEFAULTS = {WARN_MB: 1024.0, WARN_PERCENT: 5.0, FLOOR_MB: 200.0}
MOST_WARN_MB = 10_240.0
"""However large the disk, with so much left nobody is warned."""

RESTART_BYTES = 32 * 2**20
"""With less, PostgreSQL cannot begin the next part of its log, and ends again at once."""

SHORTAGES = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EMFILE, errno.ENFILE)
"""What a process cannot mend, and a person can while it goes on."""

LOOK_S = 5.0
"""How often the disk is looked at, and while it is short of room:"""

SHORT_LOOK_S = 1.0
_MB = 2**20


@dataclass(frozen=True, slots=True)
class DiskRoom:
    """What a disk has left."""

    free_bytes: int
    total_bytes: int
    is_read_only: bool = False

    @property
    def takes_restarts(self) -> bool:
        """Say whether a server that ended for want of room can start again."""
        return not self.is_read_only and self.free_bytes >= RESTART_BYTES


def look(folder: Path) -> DiskRoom | None:
    """Ask the kernel; None: it does not say."""
    try:
        found = os.statvfs(folder)
    except OSError:
        return None
    return DiskRoom(
        found.f_bavail * found.f_frsize,
        found.f_blocks * found.f_frsize,
        _is_read_only(folder, found.f_flag),
    )


def _is_read_only(folder: Path, flags: int) -> bool:
    """Say whether nothing can be written; a file system that failed may say so to writes alone."""
    if flags & os.ST_RDONLY:
        return True
    try:
        os.utime(folder)
    except OSError as error:
        return error.errno == errno.EROFS
    return False


def warning(folder: Path, room: DiskRoom, environment: Mapping[str, str] = os.environ) -> str:
    """Say what a person has to know of a disk; empty: it has room enough."""
    if room.is_read_only:
        return (
            f"The disk of {folder} can only be read: nothing is written and no run is started. "
            "Find out why the system has made it so, and let it be written again."
        )
    warn_mb, percent, floor_mb = (_number(environment, name) for name in DEFAULTS)
    share_mb = min(room.total_bytes / _MB * percent / 100, MOST_WARN_MB)
    if room.free_bytes >= max(warn_mb, share_mb, floor_mb) * _MB:
        return ""
    floor_bytes = floor_mb * _MB
    is_full = room.free_bytes < floor_bytes
    return (
        f"The disk of {folder} has {_size(room.free_bytes)} left; "
        f"{'no run is' if is_full else 'runs are not'} started below {_size(floor_bytes)}. "
        "Free some space on it: old files, exports and backups."
    )


def _size(size_bytes: float) -> str:
    return f"{size_bytes / 1e9:.1f} GB" if size_bytes >= 1e8 else f"{size_bytes / 1e6:.0f} MB"


def _number(environment: Mapping[str, str], name: str) -> float:
    try:
        return float(environment[name])
    except (KeyError, ValueError):
        return DEFAULTS[name]


class Disk:
    """The disk under the data directory, looked at now and then."""

    def __init__(self, folder: Path, console: Console) -> None:
        self._folder = folder
        self._console = console
        self._said = ""
        self._had_room = True
        self.look_at_s = 0.0
        """When it is looked at next, on the monotonic clock."""

        self.was_looked_at = False
        """At the last turn."""

    def takes_restarts(self) -> bool:
        """Say whether a process that ends now can start again; so it counts if nobody can tell."""
        found = look(self._folder)
        if found is not None and not found.takes_restarts:
            self._had_room = False
            self.look_at_s = min(self.look_at_s, monotonic() + SHORT_LOOK_S)
        return found is None or found.takes_restarts

    def look(self) -> bool:
        """Look if it is time, say what has changed, and tell whether there is room again."""
        self.was_looked_at = monotonic() >= self.look_at_s
        if not self.was_looked_at:
            return False
        found = look(self._folder)
        text = "" if found is None else warning(self._folder, found)
        kind = text.partition(";")[2] or text  # how much is left changes all the time
        if kind != self._said:
            self._console.line(text or f"The disk of {self._folder} has room enough again")
        self._said = kind
        has_room = found is None or found.takes_restarts
        is_back, self._had_room = has_room and not self._had_room, has_room
        self.look_at_s = monotonic() + (LOOK_S if has_room and not text else SHORT_LOOK_S)
        return is_back
