"""Tables of the journal, their migrations, and one row of each as plain data."""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass
from uuid import UUID

from labweb.domain.errors import LabError
from labweb.domain.messages import Do, Signed, decode_command
from labweb.domain.runs.edge import ActionState

VERSION_1 = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE action (
    action_id TEXT PRIMARY KEY,
    dseq INTEGER NOT NULL,
    epoch INTEGER NOT NULL,
    line TEXT NOT NULL,
    device_id TEXT NOT NULL,
    body TEXT NOT NULL,
    key_id TEXT NOT NULL,
    signature TEXT NOT NULL,
    st TEXT NOT NULL,
    accepted_mono_s REAL NOT NULL,
    accepted_boot_id TEXT NOT NULL,
    accepted_wall_s REAL NOT NULL,
    is_cancel_wanted INTEGER NOT NULL DEFAULT 0,
    prestate TEXT,
    report TEXT,
    conclusion TEXT
);
CREATE INDEX action_open ON action (line, st, dseq);
CREATE INDEX action_device ON action (device_id, st);
CREATE TABLE event (
    seq INTEGER PRIMARY KEY,
    prev_hash TEXT NOT NULL,
    hash TEXT NOT NULL,
    kind TEXT NOT NULL,
    action_id TEXT,
    at_s REAL NOT NULL,
    body TEXT NOT NULL
);
CREATE TABLE resource_state (
    id TEXT PRIMARY KEY,
    rev INTEGER NOT NULL,
    view TEXT NOT NULL,
    quarantined_by TEXT
);
CREATE INDEX resource_quarantined ON resource_state (quarantined_by);
CREATE TABLE tombstone (action_id TEXT PRIMARY KEY, dseq INTEGER NOT NULL);
CREATE TABLE refusal (subject TEXT PRIMARY KEY);
CREATE TABLE device_fence (device_id TEXT PRIMARY KEY, max_dseq INTEGER NOT NULL);
"""

MIGRATIONS = (VERSION_1,)
"""Script by version; forward only, one entry per released version."""


class JournalError(LabError):
    """The journal cannot be read or written: nothing may be actuated."""

    default_code = "journal.unusable"


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionRow:
    """One action of the journal."""

    action_id: UUID
    dseq: int
    epoch: int
    line: str
    device_id: UUID
    body: str
    key_id: str
    signature: str
    st: ActionState
    accepted_mono_s: float
    accepted_boot_id: str
    accepted_wall_s: float
    is_cancel_wanted: bool
    prestate: str | None
    report: str | None
    conclusion: str | None

    @property
    def signed(self) -> Signed:
        """Return the command as it came."""
        return Signed(body=self.body, key_id=self.key_id, signature=self.signature)

    @property
    def do(self) -> Do:
        """Return the command, read anew from its signed text."""
        command = decode_command(self.body)
        if not isinstance(command, Do):
            raise JournalError(f"action {self.action_id} holds a {type(command).__name__}")
        return command


def to_action(row: sqlite3.Row) -> ActionRow:
    """Read one row of the table `action`."""
    values = {key: row[key] for key in row.keys()}  # noqa: SIM118 - a Row iterates over values
    values["action_id"] = UUID(values["action_id"])
    values["device_id"] = UUID(values["device_id"])
    values["st"] = ActionState(values["st"])
    values["is_cancel_wanted"] = bool(values["is_cancel_wanted"])
    return ActionRow(**values)


def migrate(connection: sqlite3.Connection) -> None:
    """Bring the tables to the newest version.

    Raises:
        JournalError: The journal is newer than this program, or an action is open while
            its tables would have to change. Nothing changed.
    """
    connection.execute("BEGIN IMMEDIATE")
    try:
        version = int(connection.execute("PRAGMA user_version").fetchone()[0])
        if version > len(MIGRATIONS):
            raise JournalError(
                f"the journal has version {version}, this program knows {len(MIGRATIONS)}: "
                "install the newer program"
            )
        if 0 < version < len(MIGRATIONS):
            _refuse_open_actions(connection)
        for number in range(version, len(MIGRATIONS)):
            for statement in MIGRATIONS[number].split(";"):
                connection.execute(statement)
            connection.execute(f"PRAGMA user_version = {number + 1}")
        connection.execute("COMMIT")
    except BaseException:
        connection.execute("ROLLBACK")
        raise


def _refuse_open_actions(connection: sqlite3.Connection) -> None:
    found = connection.execute(
        "SELECT count(*) FROM action WHERE st IN ('accepted', 'started', 'actuated', 'in_doubt')"
    ).fetchone()
    if found[0]:
        raise JournalError(f"{found[0]} actions are open: finish them with the older program first")
