"""A witness outside the journal's file: how far the journal had come.

A journal that was restored from an older copy ends before its seal, and that shows.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from labweb.domain.runs.journal import JournalError, is_raised
from labweb.domain.runs.journal import Seal as Seal
from workers import faults


def read_seal(path: Path) -> Seal | None:
    """Read the seal; None: there is none yet.

    Raises:
        JournalError: The file cannot be read.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=Seal)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.MsgspecError) as exc:
        raise JournalError(f"the journal's seal {path} cannot be read: {exc}") from exc


def create_seal(path: Path, seal: Seal) -> None:
    """Bind the seal to a journal that was made just now, whatever stood there before."""
    with _locked(path):
        _write(path, seal)


def raise_seal(path: Path, seal: Seal, hash_at: Callable[[int], str | None]) -> None:
    """Move the seal forward, if the journal holds the event that is sealed now.

    Args:
        path: Where the seal lies.
        seal: The end of the journal.
        hash_at: Finds the hash of one of the journal's events; None: it has none.

    Raises:
        JournalError: It belongs to another journal, or cannot be written.
    """
    with _locked(path):
        found = read_seal(path)
        if found is None:
            raise JournalError(f"the seal {path} is gone")
        if is_raised(found, seal, hash_at_found=hash_at(found.seq)):
            _write(path, seal)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    try:
        handle = os.open(path.with_suffix(".lock"), os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as exc:
        raise JournalError(f"the seal {path} cannot be locked: {exc}") from exc
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _write(path: Path, seal: Seal) -> None:
    fresh = path.with_suffix(".new")
    try:
        with fresh.open("wb") as stream:
            stream.write(msgspec.json.encode(seal))
            stream.flush()
            os.fsync(stream.fileno())
        faults.point("seal.before_replace")
        fresh.replace(path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as exc:
        raise JournalError(f"the seal {path} cannot be written: {exc}") from exc
