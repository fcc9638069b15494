"""One atomic write to the journal: rows and the events that tell of them."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.canonical_json import canonical, without_null
from labweb.domain.messages.commands import ResourceView
from labweb.domain.messages.events import EdgeEvent, event_hash
from labweb.domain.runs.host_actions.host_state import state_of
from labweb.domain.runs.host_journal.action_states import ActionState, HostState
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_journal.journal_rows import ActionRow, HeldResource, JournalError
from workers.journal.journal_schema import SELECT_ACTION, SELECT_STATE, SELECT_UNFINISHED, to_action

PROGRESS = frozenset({"accepted", "started", "actuated"})
"""Events that need not be told at once: more of the same action follows."""

_KEPT = {"prestate", "report"}


class AtomicWrite:
    """What may be done inside `Journal.write`."""

    def __init__(
        self,
        connection: sqlite3.Connection,
        *,
        journal_id: UUID,
        head: tuple[int, str],
        moment: Callable[[], HostMoment],
    ) -> None:
        self._connection = connection
        self._journal_id = journal_id
        self.first = head
        """The last event before this write."""

        self._moment = moment
        self.head = head
        # What was read or written here stays as it is: nobody else writes meanwhile.
        self._host: dict[str, HostState] = {}
        self._states: dict[UUID, ActionState] = {}
        self._resources: dict[UUID, HeldResource | None] = {}
        self.is_urgent = False
        """An event was appended that the server waits for."""

        self.is_binding = False
        """An action was started: the seal has to hold that before a byte is sent."""

    @property
    def has_appended(self) -> bool:
        """Say whether an event was appended."""
        return self.head != self.first

    # --- the event log ---

    def append(self, kind: str, action_id: UUID | None, body: dict[str, Any]) -> None:
        """Append an event to the hash chain."""
        seq, prev = self.head
        text = canonical(body)
        if b"\\u0000" in text:  # what a device said, perhaps: the server could not keep it
            body = without_null(body)
            text = canonical(body)
        at = self._moment()
        event = EdgeEvent(
            seq=seq + 1,
            prev_hash=prev,
            hash="",
            kind=kind,
            action_id=action_id,
            at_s=at.wall_s,
            body=body,
            mono_s=at.mono_s,
            boot_id=at.boot_id,
        )
        digest = event_hash(self._journal_id, prev, event, text)
        told = (_text(action_id), event.at_s, text.decode(), at.mono_s, at.boot_id)
        row = (event.seq, prev, digest, kind, *told)
        self._run("INSERT INTO event VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", row)
        self.head = (event.seq, digest)
        self.is_urgent = self.is_urgent or kind not in PROGRESS
        self.is_binding = self.is_binding or kind == "started"

    def prune(self, acked_seq: int, before_s: float) -> int:
        """Delete acknowledged events from before that time, but never the last one."""
        last = min(acked_seq, self.head[0] - 1)
        return self._run("DELETE FROM event WHERE seq <= ? AND at_s < ?", (last, before_s)).rowcount

    # --- the host ---

    def meta(self) -> dict[str, str]:
        """Return all remembered values of the host."""
        return {row[0]: row[1] for row in self._run("SELECT key, value FROM meta")}

    def set_meta(self, key: str, value: str | None) -> None:
        """Remember a value; None forgets it."""
        self._host.clear()
        if value is None:
            self._run("DELETE FROM meta WHERE key = ?", (key,))
        else:
            self._run("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, value))

    def host_state(self, boot_id: str) -> HostState:
        """Return what decides whether anything may start, as of this write."""
        if boot_id not in self._host:
            self._host[boot_id] = state_of(dict(self._run(SELECT_STATE)), boot_id)
        return self._host[boot_id]

    # --- actions ---

    def action(self, action_id: UUID) -> ActionRow | None:
        """Return one action, or None."""
        found = self._run(SELECT_ACTION, (str(action_id),)).fetchone()
        return None if found is None else to_action(found)

    def state_of(self, action_id: UUID) -> ActionState | None:
        """Return where an action stands as of this write, or None."""
        if action_id in self._states:
            return self._states[action_id]
        found = self._run("SELECT st FROM action WHERE action_id = ?", (str(action_id),)).fetchone()
        return None if found is None else ActionState(found[0])

    def open_rows(self) -> list[ActionRow]:
        """Return the actions that have not ended, in dispatch order."""
        return [to_action(row) for row in self._run(f"{SELECT_UNFINISHED} ORDER BY dseq")]

    def insert_action(self, row: ActionRow) -> None:
        """Keep a new action."""
        self._run(
            "INSERT INTO action (action_id, dseq, epoch, line, device_id, body, key_id, signature,"
            " st, accepted_mono_s, accepted_boot_id, accepted_wall_s)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                str(row.action_id),
                row.dseq,
                row.epoch,
                row.line,
                str(row.device_id),
                row.body,
                row.key_id,
                row.signature,
                row.st.value,
                row.accepted_mono_s,
                row.accepted_boot_id,
                row.accepted_wall_s,
            ),
        )

    def move(
        self, action_id: UUID, before: ActionState, after: ActionState, **kept: dict[str, Any]
    ) -> None:
        """Take an action from one state to the next, if it is in the first.

        Args:
            action_id: The action.
            before: Where it has to stand.
            after: Where it goes.
            kept: What is kept of it until it ends: `prestate` or `report`.

        Raises:
            JournalError: It is in another state; somebody else was faster.
        """
        if not kept.keys() <= _KEPT:
            raise ValueError(sorted(kept))
        columns = "".join(f", {name} = ?" for name in kept)
        texts = [canonical(value).decode() for value in kept.values()]
        found = self._run(
            f"UPDATE action SET st = ?{columns} WHERE action_id = ? AND st = ?",  # noqa: S608 - of three names
            (after.value, *texts, str(action_id), before.value),
        )
        if found.rowcount != 1:
            raise JournalError(
                f"action {action_id} is not {before.value}", code="journal.lost_claim"
            )
        self._states[action_id] = after

    def want_cancel(self, action_id: UUID) -> None:
        """Remember that a running action shall be stopped."""
        self._run("UPDATE action SET is_cancel_wanted = 1 WHERE action_id = ?", (str(action_id),))

    def blocked_by(self, device_id: UUID) -> str | None:
        """Return the action in doubt that closes a device, or None."""
        found = self._run(
            "SELECT action_id FROM action WHERE device_id = ? AND st = 'in_doubt' LIMIT 1",
            (str(device_id),),
        ).fetchone()
        return None if found is None else str(found[0])

    def max_fence(self, device_id: UUID) -> int:
        """Return the highest dispatch that has started on a device."""
        found = self._run(
            "SELECT max_dseq FROM device_fence WHERE device_id = ?", (str(device_id),)
        ).fetchone()
        return 0 if found is None else int(found[0])

    def raise_fence(self, device_id: UUID, dseq: int) -> None:
        """Let no earlier dispatch start on a device any more."""
        self._run(
            "INSERT INTO device_fence VALUES (?, ?) ON CONFLICT (device_id)"
            " DO UPDATE SET max_dseq = max(max_dseq, excluded.max_dseq)",
            (str(device_id), dseq),
        )

    def is_tombstoned(self, action_id: UUID) -> bool:
        """Say whether an action was cancelled before it arrived."""
        query = "SELECT 1 FROM tombstone WHERE action_id = ?"
        return self._run(query, (str(action_id),)).fetchone() is not None

    def add_tombstone(self, action_id: UUID, dseq: int) -> bool:
        """Let an action that has not arrived never start; False: that was known."""
        query = "INSERT OR IGNORE INTO tombstone VALUES (?, ?)"
        return self._run(query, (str(action_id), dseq)).rowcount == 1

    def is_first_refusal(self, subject: str) -> bool:
        """Remember a refusal; False: it is on record, and is not told again."""
        query = "INSERT OR IGNORE INTO refusal VALUES (?)"
        return self._run(query, (subject,)).rowcount == 1

    # --- resources ---

    def resource(self, resource_id: UUID) -> HeldResource | None:
        """Return a resource as this host knows it, or None."""
        if resource_id not in self._resources:
            found = self._run(
                "SELECT view, quarantined_by FROM resource_state WHERE id = ?", (str(resource_id),)
            ).fetchone()
            self._resources[resource_id] = None if found is None else _to_held(found)
        return self._resources[resource_id]

    def put_resource(self, held: HeldResource) -> None:
        """Keep a resource."""
        view = held.view
        row = (str(view.id), view.rev, canonical(view).decode(), held.quarantined_by)
        self._run("INSERT OR REPLACE INTO resource_state VALUES (?, ?, ?, ?)", row)
        self._resources[view.id] = held

    def drop_resource(self, resource_id: UUID) -> None:
        """Forget a resource that another host owns from here on."""
        self._run("DELETE FROM resource_state WHERE id = ?", (str(resource_id),))
        self._resources[resource_id] = None

    def quarantined_for(self, action_id: UUID) -> list[HeldResource]:
        """Return the resources that an action in doubt has closed."""
        found = self._run(
            "SELECT view, quarantined_by FROM resource_state WHERE quarantined_by = ? ORDER BY id",
            (str(action_id),),
        ).fetchall()
        return [_to_held(row) for row in found]

    def _run(self, query: str, values: tuple[Any, ...] = ()) -> sqlite3.Cursor:
        try:
            return self._connection.execute(query, values)
        except sqlite3.Error as exc:
            raise JournalError(f"the journal cannot be written: {exc}") from exc


def _to_held(row: sqlite3.Row) -> HeldResource:
    view = msgspec.json.decode(row[0], type=ResourceView)
    return HeldResource(view=view, quarantined_by=row[1])


def _text(value: UUID | None) -> str | None:
    return None if value is None else str(value)
