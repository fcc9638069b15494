"""A disk that is full when a test wants it, and the resources of processes that run out."""

from __future__ import annotations

import os
import resource
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

FEW_FILES = 8
"""Every process has more of them open."""

SIZE_MB = 320
"""A lab takes 60 of it, and its database keeps 16 for each further part of its log."""


class SmallDisk:
    """A file system in memory, and a file that takes what is left of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._ballast = folder / "ballast"

    def fill(self, *, but_mb: int = 0) -> None:
        """Leave so much, or nothing at all."""
        self.clear()
        found = os.statvfs(self.folder)
        with self._ballast.open("wb", buffering=0) as file:
            if but_mb:
                os.posix_fallocate(
                    file.fileno(), 0, found.f_bavail * found.f_frsize - but_mb * 2**20
                )
                return
            for block in (2**20, 4096, 1):
                with suppress(OSError):
                    while file.write(b"\0" * block):
                        pass

    def fill_page_of(self, file: Path) -> None:
        """Take what is left in the last page of a file, into which a few more words would go."""
        with file.open("ab", buffering=0) as stream, suppress(OSError):
            while stream.write(b"\n"):
                pass

    def left_mb(self) -> int:
        """Return the room that is left now, in 10⁶ bytes."""
        found = os.statvfs(self.folder)
        return round(found.f_bavail * found.f_frsize / 1e6)

    def clear(self) -> None:
        """Give it all back."""
        self._ballast.unlink(missing_ok=True)


@contextmanager
def small_disk(folder: Path) -> Iterator[SmallDisk]:
    """Mount one; the test is skipped where that is not allowed."""
    options = ["-t", "tmpfs", "-o", f"size={SIZE_MB}m,mode=0755", "tmpfs", str(folder)]
    done = subprocess.run(["mount", *options], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"a small disk cannot be mounted here: {done.stderr.strip()}")
    try:
        yield SmallDisk(folder)
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@contextmanager
def failing_disk(folder: Path, image: Path) -> Iterator[Path]:
    """Mount a file as a disk; return the file that makes the kernel take it for damaged."""
    with image.open("wb") as file:
        file.truncate(600 * 2**20)
    for command in (
        ["mkfs.ext4", "-q", str(image)],
        ["mount", "-o", "loop,errors=remount-ro", str(image), str(folder)],
    ):
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False)
        except FileNotFoundError:
            pytest.skip(f"{command[0]} is not installed")
        if done.returncode:
            pytest.skip(f"a disk of its own cannot be mounted here: {done.stderr.strip()}")
    try:
        found = ["findmnt", "-no", "SOURCE", str(folder)]
        device = subprocess.run(found, capture_output=True, text=True, check=True).stdout.strip()
        trigger = Path("/sys/fs/ext4") / Path(device).name / "trigger_fs_error"
        if not trigger.exists():
            pytest.skip("the kernel lets nobody declare a disk damaged")
        yield trigger
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@contextmanager
def no_more_files(pids: Iterable[int]) -> Iterator[None]:
    """Let processes open nothing beyond what they have open now."""
    before: dict[int, tuple[int, int]] = {}
    for pid in pids:
        with suppress(ProcessLookupError):
            before[pid] = limits = resource.prlimit(pid, resource.RLIMIT_NOFILE)
            resource.prlimit(pid, resource.RLIMIT_NOFILE, (FEW_FILES, limits[1]))
    try:
        yield
    finally:
        for pid, limits in before.items():
            with suppress(ProcessLookupError):
                resource.prlimit(pid, resource.RLIMIT_NOFILE, limits)
