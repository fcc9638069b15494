"""A witness outside the journal's file: how far the journal had come.

A journal that was restored from an older copy ends before its seal, and that shows.

The file has two places, a block apart, written in turn: one write and one fdatasync of a block
that is there already, so that nothing but the block itself has to reach the disk. A power cut
within a write damages the one place, and the other still holds the seal before.
"""

from __future__ import annotations

import fcntl
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from labweb.domain.runs.host_journal.journal_rows import JournalError, is_raised
from labweb.domain.runs.host_journal.journal_rows import Seal as Seal
from workers.base import faults

BLOCK_BYTES = 4096
PLACES_COUNT = 2


def read_seal(path: Path) -> Seal | None:
    """Read the seal; None: there is none.

    Raises:
        JournalError: The file cannot be read.
    """
    try:
        return _newest(path.read_bytes(), path)[0]
    except FileNotFoundError:
        return None
    except OSError as exc:
        raise JournalError(f"the journal's seal {path} cannot be read: {exc}") from exc


def create_seal(path: Path, seal: Seal) -> None:
    """Bind the seal to a journal that was made just now, whatever stood there before."""
    fresh = path.with_suffix(".new")
    try:
        with fresh.open("wb") as stream:
            stream.write(_render(seal).ljust(BLOCK_BYTES * PLACES_COUNT))
            stream.flush()
            os.fsync(stream.fileno())
        fresh.replace(path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as exc:
        raise JournalError(f"the seal {path} cannot be written: {exc}") from exc


def raise_seal(path: Path, seal: Seal, hash_at: Callable[[int], str | None]) -> None:
    """Move the seal forward, if the journal holds the event that is sealed now.

    Args:
        path: Where the seal lies.
        seal: The end of the journal.
        hash_at: Finds the hash of one of the journal's events; None: it has none.

    Raises:
        JournalError: It belongs to another journal, or cannot be written.
    """
    with _locked(path) as handle:
        found, place = _newest(os.pread(handle, BLOCK_BYTES * PLACES_COUNT, 0), path)
        if is_raised(found, seal, hash_at_found=hash_at(found.seq)):
            faults.point("seal.before_write")
            os.pwrite(handle, _render(seal), (place + 1) % PLACES_COUNT * BLOCK_BYTES)
            os.fdatasync(handle)


@contextmanager
def _locked(path: Path) -> Iterator[int]:
    """Open the seal and keep others from moving it meanwhile."""
    try:
        handle = os.open(path, os.O_RDWR)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield handle
        finally:
            os.close(handle)
    except FileNotFoundError as exc:
        raise JournalError(f"the seal {path} is gone") from exc
    except OSError as exc:
        raise JournalError(f"the seal {path} cannot be written: {exc}") from exc


def _render(seal: Seal) -> bytes:
    text = msgspec.json.encode(seal)
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _newest(content: bytes, path: Path) -> tuple[Seal, int]:
    """Find the seal that was written last, and its place.

    Raises:
        JournalError: No place holds a whole one.
    """
    found: list[tuple[Seal, int]] = []
    for place in range(PLACES_COUNT):
        line = content[place * BLOCK_BYTES : (place + 1) * BLOCK_BYTES].partition(b"\n")[0]
        check, _, text = line.partition(b" ")
        if check == b"%08x" % zlib.crc32(text):
            found.append((msgspec.json.decode(text, type=Seal), place))
    if not found and content.startswith(b"{"):  # as it was written before it had two places
        text = content[:BLOCK_BYTES].rstrip(b"\0")
        with suppress(msgspec.MsgspecError):
            found.append((msgspec.json.decode(text, type=Seal), 0))
    if not found:
        raise JournalError(f"the journal's seal {path} cannot be read: it is damaged")
    return max(found, key=lambda one: one[0].seq)
