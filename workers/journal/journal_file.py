"""The journal's file: a commit reaches the disk, and one process writes at a time.

Source:
    SQLite documentation, "Write-Ahead Logging", "PRAGMA synchronous", "PRAGMA busy_timeout" and
    "PRAGMA cache_spill"; fdatasync(2).
"""

from __future__ import annotations

import sqlite3
import threading
import time
from pathlib import Path

from labweb.domain.runs.host_journal.journal_rows import JournalError

BUSY_TIMEOUT_S = 5.0
BUSY_LOOK_S = 0.0002
"""How soon a write that waits for another one looks again; SQLite's own waits begin at 1 ms."""

LOG_PAGES = 1000
"""SQLite copies its log into the file when it holds so many pages, and begins it anew."""


class _Readable:
    """Turns what SQLite raises into the journal's own error; on the way of every step."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, _sort: object, error: BaseException | None, _trace: object) -> None:
        if isinstance(error, sqlite3.Error):
            raise JournalError(f"the journal cannot be used: {error}") from error


readable = _Readable()


def open_file(path: Path) -> sqlite3.Connection:
    """Open a journal's file.

    Raises:
        JournalError: It cannot be opened.
    """
    try:
        connection = sqlite3.connect(
            path, timeout=BUSY_TIMEOUT_S, isolation_level=None, check_same_thread=False
        )
    except sqlite3.Error as exc:
        raise JournalError(f"the journal {path} cannot be opened: {exc}") from exc
    try:
        connection.row_factory = sqlite3.Row
        _be_patient(connection)
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA foreign_keys = ON")
    except sqlite3.Error as exc:
        connection.close()
        raise JournalError(f"the journal {path} cannot be opened: {exc}") from exc
    return connection


def lengthen_log(connection: sqlite3.Connection, path: Path) -> None:
    """Give the log the length at once that it comes to anyway, and leave nothing else behind.

    A commit that makes its file longer has to bring the file's new length to the disk too, and
    takes twice as long. Pages that do not fit into memory go to the log before their commit, and
    those of a write that is taken back are written over.

    Raises:
        sqlite3.Error: The disk holds no more, say; the journal is as it was.
    """
    page_bytes: int = connection.execute("PRAGMA page_size").fetchone()[0]
    log = path.with_name(f"{path.name}-wal")
    if log.is_file() and log.stat().st_size >= LOG_PAGES * page_bytes:
        return
    pages_count: int = connection.execute("PRAGMA cache_size").fetchone()[0]
    begin_write(connection)
    try:
        connection.execute("PRAGMA cache_size = 10")
        connection.execute("CREATE TABLE filling (pages BLOB)")
        connection.execute("INSERT INTO filling VALUES (zeroblob(?))", (LOG_PAGES * page_bytes,))
    finally:
        if connection.in_transaction:  # SQLite itself takes back what found no room
            connection.execute("ROLLBACK")
        connection.execute(f"PRAGMA cache_size = {pages_count}")


def begin_write(connection: sqlite3.Connection) -> None:
    """Begin a write as soon as no other process writes.

    Raises:
        sqlite3.Error: Its turn has not come in time, or the file cannot be used.
    """
    deadline_s, pause = time.monotonic() + BUSY_TIMEOUT_S, threading.Event()
    connection.execute("PRAGMA busy_timeout = 0")
    try:
        while not _has_begun(connection):
            if time.monotonic() > deadline_s:
                raise sqlite3.OperationalError("database is locked")
            pause.wait(BUSY_LOOK_S)
    finally:
        _be_patient(connection)


def _has_begun(connection: sqlite3.Connection) -> bool:
    try:
        connection.execute("BEGIN IMMEDIATE")
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY:
            raise
        return False
    return True


def _be_patient(connection: sqlite3.Connection) -> None:
    """Let SQLite wait by itself, for whoever puts a log back after a crash, say."""
    connection.execute(f"PRAGMA busy_timeout = {int(BUSY_TIMEOUT_S * 1000)}")
