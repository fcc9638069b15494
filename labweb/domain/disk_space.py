"""When a disk has too little room left, and what is said about it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from labweb.domain.errors import Finding

_GIB = 2**30

MOST_WARN_BYTES = 10 * _GIB
"""However large the disk, with so much left nobody is warned."""

ADVICE = "Free some space on it: old files, exports and backups."


class DiskRoomLevel(StrEnum):
    """How a disk stands."""

    OK = "ok"
    LOW = "low"
    """A person is warned."""

    FULL = "full"
    """No run is started."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Floors:
    """How much has to be left."""

    warn_bytes: float = _GIB
    warn_ratio: float = 0.05
    """Of the whole disk; the larger of the two counts, up to `MOST_WARN_BYTES`."""

    floor_bytes: float = 200 * 2**20
    """With less, no run is started."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DiskSpace:
    """What a disk has left."""

    name: str
    """Whose it is, as a person reads it after "the disk of"."""

    free_bytes: int
    total_bytes: int = 0
    """0: nobody knows."""

    is_read_only: bool = False

    def level(self, floors: Floors) -> DiskRoomLevel:
        """Say how it stands."""
        if self.is_read_only or self.free_bytes < floors.floor_bytes:
            return DiskRoomLevel.FULL
        share_bytes = min(self.total_bytes * floors.warn_ratio, MOST_WARN_BYTES)
        return (
            DiskRoomLevel.LOW
            if self.free_bytes < max(floors.warn_bytes, share_bytes)
            else DiskRoomLevel.OK
        )

    def headline(self) -> str:
        """Say in a few words what is the matter with it."""
        if self.is_read_only:
            return f"The disk of {self.name} can only be read"
        return f"The disk of {self.name} has {_size(self.free_bytes)} left"

    def consequence(self, floors: Floors) -> str:
        """Say what follows, and what to do."""
        if self.is_read_only:
            return (
                "No run is started. Find out why the system has made it so, and let it be "
                "written again."
            )
        is_full = self.level(floors) is DiskRoomLevel.FULL
        what = "No run is started" if is_full else "Runs are not started"
        return f"{what} below {_size(floors.floor_bytes)}. {ADVICE}"


def check_room(disks: Iterable[DiskSpace], floors: Floors) -> list[Finding]:
    """List which of the disks have too little room for a run to be started."""
    return [
        Finding("run.disk_full", f"{disk.headline()}: {_lowered(disk.consequence(floors))}")
        for disk in disks
        if disk.level(floors) is DiskRoomLevel.FULL
    ]


def _lowered(text: str) -> str:
    return text[:1].lower() + text[1:]


def _size(size_bytes: float) -> str:
    return f"{size_bytes / 1e9:.1f} GB" if size_bytes >= 1e8 else f"{size_bytes / 1e6:.0f} MB"
