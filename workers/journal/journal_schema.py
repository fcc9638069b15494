"""Tables of the journal, their migrations, and one row of each as plain data."""

from __future__ import annotations

import sqlite3
from dataclasses import fields
from uuid import UUID

import msgspec

from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.host_actions.host_state import STATE_KEYS
from labweb.domain.runs.host_journal.action_states import FINAL, ActionState
from labweb.domain.runs.host_journal.journal_rows import ActionRow as ActionRow
from labweb.domain.runs.host_journal.journal_rows import JournalError as JournalError

# An action's row has a conclusion that nobody writes any more: its end is an event.
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

VERSION_2 = """
ALTER TABLE event ADD COLUMN mono_s REAL;
ALTER TABLE event ADD COLUMN boot_id TEXT NOT NULL DEFAULT ''
"""

MIGRATIONS = (VERSION_1, VERSION_2)
"""Script by version; forward only, one entry per released version."""


_UNFINISHED = f"st NOT IN ({', '.join(sorted(map(repr, map(str, FINAL))))})"
"""Said so that SQLite still takes the rows of one state in the order of the index."""

FROM_UNFINISHED = f"FROM action INDEXED BY action_waits WHERE {_UNFINISHED}"
"""The actions that have not ended, however many have."""

_COLUMNS = ", ".join(field.name for field in fields(ActionRow))
SELECT_ACTION = f"SELECT {_COLUMNS} FROM action WHERE action_id = ?"  # noqa: S608 - our own names
SELECT_UNFINISHED = f"SELECT {_COLUMNS} {FROM_UNFINISHED}"

SELECT_STATE = f"SELECT key, value FROM meta WHERE key IN ({', '.join(map(repr, STATE_KEYS))})"  # noqa: S608 - our own names
"""What decides whether anything may start, without the devices and keys, which are long."""

SELECT_NEXT = " UNION ALL ".join(
    f"SELECT * FROM ({SELECT_UNFINISHED} AND line = ? AND st = '{st}' ORDER BY dseq LIMIT ?)"  # noqa: S608 - our own names
    for st in ("actuated", "accepted")
)

INDEXES = (
    "DROP INDEX IF EXISTS action_open",
    "DROP INDEX IF EXISTS action_device",
    "DROP INDEX IF EXISTS action_unfinished",
    f"CREATE INDEX IF NOT EXISTS action_waits ON action (line, st, dseq) WHERE {_UNFINISHED}",
    "CREATE INDEX IF NOT EXISTS action_in_doubt ON action (device_id) WHERE st = 'in_doubt'",
)
"""Change no answer, only how soon it comes; a journal gets them whatever its version.

None of them holds an action that has ended, which is asked for by its id alone: each step writes
all pages that it changes twice, to the log and to the file. One that is changed gets another name:
a journal keeps what it has.
"""


def to_action(row: sqlite3.Row) -> ActionRow:
    """Read one row of the table `action`."""
    values = dict(zip(row.keys(), row, strict=True))
    values["action_id"] = UUID(values["action_id"])
    values["device_id"] = UUID(values["device_id"])
    values["st"] = ActionState(values["st"])
    values["is_cancel_wanted"] = bool(values["is_cancel_wanted"])
    return ActionRow(**values)


def to_event(row: sqlite3.Row) -> EdgeEvent:
    """Read one row of the table `event`."""
    return EdgeEvent(
        seq=row["seq"],
        prev_hash=row["prev_hash"],
        hash=row["hash"],
        kind=row["kind"],
        action_id=None if row["action_id"] is None else UUID(row["action_id"]),
        at_s=row["at_s"],
        body=msgspec.json.decode(row["body"]),
        mono_s=row["mono_s"],
        boot_id=row["boot_id"],
    )


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
        for statement in INDEXES:
            connection.execute(statement)
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
