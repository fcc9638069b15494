"""The journal: what an edge host knows for certain, on disk before it acts.

Several processes open the same file: accept, uplink and one executor for each line. Every
step of an action is one transaction that also appends its event, so that the event log
is the outbox. `synchronous=FULL` makes each commit reach the disk.

Source:
    SQLite documentation, "Write-Ahead Logging" and "PRAGMA synchronous".
"""

from __future__ import annotations

import os
import sqlite3
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, TypeVar, cast
from uuid import UUID, uuid4

import msgspec

from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.messages.events import MAX_EVENTS_PER_FRAME, EdgeEvent
from labweb.domain.messages.frames import MAX_FRAME_BYTES
from labweb.domain.runs.host_actions.host_state import state_of
from labweb.domain.runs.host_journal.action_states import ActionState, HostState
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_journal.journal_rows import (
    ActionRow,
    JournalChain,
    JournalError,
    Seal,
    find_regression,
)
from workers.base import faults
from workers.base.wake_pipe import ring
from workers.journal import journal_schema as schema
from workers.journal.atomic_write import AtomicWrite
from workers.journal.journal_file import begin_write, lengthen_log, open_file, readable
from workers.journal.journal_witness import create_seal, raise_seal, read_seal

T = TypeVar("T")

BOOT_ID_FILE = Path("/proc/sys/kernel/random/boot_id")


def boot_id() -> str:
    """Return what tells one start of the machine from the next."""
    return os.environ.get("LABWEB_BOOT_ID") or BOOT_ID_FILE.read_text("ascii").strip()


def since_boot_s() -> float:
    """Return seconds since the machine started, those in which it slept among them.

    Source:
        clock_gettime(2), CLOCK_BOOTTIME: what may start for an hour must not start after a
        night with the lid closed, for which CLOCK_MONOTONIC stands still.
    """
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class Journal:
    """One process's hold on the journal. One thread at a time may use each object."""

    def __init__(
        self,
        path: Path,
        *,
        wall_s: Callable[[], float] = time.time,
        mono_s: Callable[[], float] = since_boot_s,
    ) -> None:
        """Open the journal of a host that `create_journal` has set up.

        Raises:
            JournalError: There is none, it is damaged, or another program made it.
        """
        if not path.is_file():
            raise JournalError(f"there is no journal at {path}")
        self.path = path
        self.boot_id = boot_id()
        self.wall_s = wall_s
        self.mono_s = mono_s
        self._seal_path = path.with_suffix(".seal")
        self.bell_path = path.with_suffix(".bell")
        self._known: dict[str, tuple[str, object]] = {}
        self._connection = open_file(path)
        try:
            with readable:
                schema.migrate(self._connection)
            self.journal_id = UUID(self._must("journal_id"))
            self.host_id = UUID(self._must("host_id"))
        except BaseException:
            self._connection.close()
            raise

    def close(self) -> None:
        """Let go of the file."""
        self._connection.close()

    # --- what it says ---

    def meta(self, key: str) -> str | None:
        """Return one remembered value of the host."""
        row = self._one("SELECT value FROM meta WHERE key = ?", (key,))
        return None if row is None else str(row[0])

    def host_state(self) -> HostState:
        """Return what decides whether anything may start."""
        with readable:
            return state_of(dict(self._connection.execute(schema.SELECT_STATE)), self.boot_id)

    def head(self) -> tuple[int, str]:
        """Return sequence number and hash of the last event; (0, "") when there is none."""
        row = self._one("SELECT seq, hash FROM event ORDER BY seq DESC LIMIT 1")
        return (0, "") if row is None else (int(row[0]), str(row[1]))

    def seal(self) -> Seal | None:
        """Return the witness outside the journal."""
        return read_seal(self._seal_path)

    def regression(self) -> str | None:
        """Say why the journal cannot be the newest one; None when nothing tells against it."""
        seal = self.seal()
        seq, _ = self.head()
        known = None if seal is None else self._hash_at(seal.seq)
        return find_regression(
            JournalChain(journal_id=self.journal_id, seq=seq, hash_at_seal=known), seal
        )

    def moment(self) -> HostMoment:
        """Return now, by this host's clocks."""
        return HostMoment(boot_id=self.boot_id, mono_s=self.mono_s(), wall_s=self.wall_s())

    def devices(self) -> list[DeviceConfig]:
        """Return the devices that the server last told this host to serve."""
        return self._decoded("devices", list[DeviceConfig]) or []

    def staged(self) -> list[DeviceConfig]:
        """Return the devices that shall have another version of their driver, with that one."""
        return self._decoded("staged", list[DeviceConfig]) or []

    def command_keys(self) -> dict[str, str]:
        """Return the public keys that may sign commands, by key id."""
        return self._decoded("command_keys", dict[str, str]) or {}

    def _decoded(self, key: str, sort: type[T]) -> T | None:
        """Return one remembered value, read anew only when its text is another one."""
        text = self.meta(key)
        if text is None:
            return None
        known = self._known.get(key)
        if known is None or known[0] != text:
            known = self._known[key] = (text, msgspec.json.decode(text, type=sort))
        return cast("T", known[1])

    def acked_seq(self) -> int:
        """Return the last event that the server has committed."""
        return int(self.meta("acked_seq") or 0)

    def action(self, action_id: UUID) -> ActionRow | None:
        """Return one action, or None."""
        row = self._one(schema.SELECT_ACTION, (str(action_id),))
        return None if row is None else schema.to_action(row)

    def state_of(self, action_id: UUID) -> ActionState | None:
        """Return where an action stands, or None."""
        row = self._one("SELECT st FROM action WHERE action_id = ?", (str(action_id),))
        return None if row is None else ActionState(row[0])

    def actions(
        self, line: str, *states: ActionState, limit_count: int | None = None
    ) -> list[ActionRow]:
        """Return the actions of a line in these states, none of them an end, in dispatch order."""
        marks = ", ".join("?" for _ in states)
        query = f"{schema.SELECT_UNFINISHED} AND line = ? AND st IN ({marks}) ORDER BY dseq LIMIT ?"
        limit = -1 if limit_count is None else limit_count
        return [schema.to_action(row) for row in self._all(query, (line, *states, limit))]

    def next_of(self, line: str, count: int) -> list[ActionRow]:
        """Return so many answered actions of a line, then as many accepted, in dispatch order."""
        return [
            schema.to_action(row)
            for row in self._all(schema.SELECT_NEXT, (line, count, line, count))
        ]

    def open_ids(self) -> list[UUID]:
        """Return every action that is not final, in dispatch order."""
        query = f"SELECT action_id {schema.FROM_UNFINISHED} ORDER BY dseq"
        return [UUID(row[0]) for row in self._all(query)]

    def open_count(self) -> int:
        """Return how many actions are not final."""
        row = self._one(f"SELECT count(*) {schema.FROM_UNFINISHED}")
        return 0 if row is None else int(row[0])

    def has_accepted(self) -> bool:
        """Say whether an action has yet to start."""
        return (
            self._one(f"SELECT 1 {schema.FROM_UNFINISHED} AND st = 'accepted' LIMIT 1") is not None
        )

    def waiting_lines(self) -> list[str]:
        """Return the lines that have something to do."""
        query = (
            f"SELECT DISTINCT line {schema.FROM_UNFINISHED} AND st IN ('accepted', 'actuated')"
            " ORDER BY line"
        )
        return [str(row[0]) for row in self._all(query)]

    def is_line_acting(self, line: str) -> bool:
        """Say whether an action of the line is between start and end."""
        return bool(self.actions(line, ActionState.STARTED, ActionState.ACTUATED))

    def blocked_by(self, device_id: UUID) -> str | None:
        """Return the action in doubt that closes a device, or None."""
        row = self._one(
            "SELECT action_id FROM action WHERE device_id = ? AND st = 'in_doubt' LIMIT 1",
            (str(device_id),),
        )
        return None if row is None else str(row[0])

    def events_after(self, seq: int) -> list[EdgeEvent]:
        """Return the next events, as many as one frame may hold."""
        found: list[EdgeEvent] = []
        size = 0
        query = "SELECT * FROM event WHERE seq > ? ORDER BY seq LIMIT ?"
        for row in self._all(query, (seq, MAX_EVENTS_PER_FRAME)):
            size += len(row["body"]) + 512  # 512: the fields beside the body, generously
            if found and size > MAX_FRAME_BYTES:
                break
            found.append(schema.to_event(row))
        return found

    # --- what is written ---

    @contextmanager
    def write(self, *, is_sealed: bool = True, is_durable: bool = True) -> Iterator[AtomicWrite]:
        """Make one atomic, durable write; then move the seal, and say that something is to tell.

        Args:
            is_sealed: False leaves the seal to the next write, or to whoever tells the
                server, unless an action is started in it. Only for what may be taken back by
                a copy of the journal: an answer of a device, whose start is sealed and then
                counts as in doubt; and an action that is accepted, which the server rings
                again.
            is_durable: False lets a power cut take the write back; the next one that is
                durable keeps it too. Only for what the server knows better.

        Raises:
            JournalError: The disk refused. Nothing is written, or, when only the seal
                failed, nothing may be actuated on the strength of it.
        """
        with nullcontext() if is_durable else self._not_durably():
            transaction = yield from self._commit()
        faults.point("journal.after_commit")
        seq, digest = transaction.head
        if transaction.is_binding or (is_sealed and transaction.has_appended):
            self._raise_seal((seq, digest), transaction.first)
        if transaction.is_urgent:
            ring(self.bell_path)

    def _commit(self) -> Generator[AtomicWrite, None, AtomicWrite]:
        with readable:
            begin_write(self._connection)
        try:
            transaction = AtomicWrite(
                self._connection,
                journal_id=self.journal_id,
                head=self.head(),
                moment=self.moment,
            )
            yield transaction
            faults.point("journal.before_commit")
            with readable:
                self._connection.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            raise
        return transaction

    @contextmanager
    def _not_durably(self) -> Iterator[None]:
        with readable:
            self._connection.execute("PRAGMA synchronous = NORMAL")
        try:
            yield
        finally:
            with readable:
                self._connection.execute("PRAGMA synchronous = FULL")

    def seal_up(self) -> None:
        """Bring the seal to the end of the journal, which a crash may have left behind.

        Nothing is told to the server that a copy could take back unseen.
        """
        self._raise_seal(self.head())

    def _raise_seal(self, head: tuple[int, str], known: tuple[int, str] = (0, "")) -> None:
        """Bring the seal to the journal's end; the hash of one event more is known."""
        seal = Seal(journal_id=self.journal_id, seq=head[0], hash=head[1])
        raise_seal(
            self._seal_path, seal, lambda seq: known[1] if seq == known[0] else self._hash_at(seq)
        )

    def lengthen_log(self) -> None:
        """Have the disk keep room for what is written next, so that each write takes less time.

        Raises:
            JournalError: The disk refused; the journal is as it was.
        """
        with readable:
            lengthen_log(self._connection, self.path)

    def prune(self, older_than_s: float) -> int:
        """Delete events that are acknowledged and older than that; return how many."""
        before_s = self.wall_s() - older_than_s
        with self.write() as tx:
            return tx.prune(self.acked_seq(), before_s)

    # --- inside ---

    def _hash_at(self, seq: int) -> str | None:
        """Return the hash of one event; of the empty beginning, the empty text."""
        if seq == 0:
            return ""
        row = self._one("SELECT hash FROM event WHERE seq = ?", (seq,))
        return None if row is None else str(row[0])

    def _one(self, query: str, values: tuple[Any, ...] = ()) -> sqlite3.Row | None:
        with readable:
            row: sqlite3.Row | None = self._connection.execute(query, values).fetchone()
            return row

    def _all(self, query: str, values: tuple[Any, ...] = ()) -> list[sqlite3.Row]:
        with readable:
            return self._connection.execute(query, values).fetchall()

    def _must(self, key: str) -> str:
        value = self.meta(key)
        if value is None:
            raise JournalError(f"{self.path} is no journal: it has no {key}")
        return value


def create_journal(path: Path, host_id: UUID) -> UUID:
    """Set up the journal of a host, unless it is there; return its identity.

    Raises:
        JournalError: The file belongs to another host, or cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    if path.is_file() and path.stat().st_size:
        journal = Journal(path)
        journal.close()
        if journal.host_id != host_id:
            raise JournalError(f"{path} belongs to host {journal.host_id}, not to {host_id}")
        return journal.journal_id
    journal_id = uuid4()
    os.close(os.open(path, os.O_RDWR | os.O_CREAT, 0o600))
    connection = open_file(path)
    try:
        schema.migrate(connection)
        create_seal(path.with_suffix(".seal"), Seal(journal_id=journal_id, seq=0, hash=""))
        connection.execute("BEGIN IMMEDIATE")
        rows = [("journal_id", str(journal_id)), ("host_id", str(host_id))]
        connection.executemany("INSERT INTO meta VALUES (?, ?)", rows)
        connection.execute("COMMIT")
    except sqlite3.Error as exc:
        raise JournalError(f"the journal {path} cannot be made: {exc}") from exc
    finally:
        connection.close()
    return journal_id


def check_journal(path: Path) -> None:
    """Read the whole file and its hash chain.

    Raises:
        JournalError: A page or an index is damaged, or the chain is broken.
    """
    connection = open_file(path)
    try:
        with readable:
            for pragma in ("quick_check", "integrity_check"):
                found = [row[0] for row in connection.execute(f"PRAGMA {pragma}")]
                if found != ["ok"]:
                    raise JournalError(f"the journal {path} is damaged: {'; '.join(found)}")
    finally:
        connection.close()
