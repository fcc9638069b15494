"""A host's disk in memory: the journal that the rules write through, and its seal.

It stands in for SQLite alone: writes are atomic, a process that dies inside one leaves
nothing of it, and whoever puts a copy back gets exactly what was copied.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import TracebackType
from typing import Any
from uuid import UUID

from labweb.domain.canonical_json import canonical
from labweb.domain.messages.events import EdgeEvent, event_hash
from labweb.domain.runs.host_actions.host_state import state_of
from labweb.domain.runs.host_journal.action_states import OPEN, ActionState, HostState
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_journal.journal_rows import ActionRow, HeldResource, JournalError

_MISSING = object()

BEGINNING = HostMoment(boot_id="boot", mono_s=0.0, wall_s=0.0)
"""A moment for writes whose time nobody asks for."""


class Disk:
    """The journal's tables."""

    def __init__(self, host_id: UUID, journal_id: UUID) -> None:
        self.journal_id = journal_id
        self.meta: dict[str, str] = {"host_id": str(host_id), "journal_id": str(journal_id)}
        self.actions: dict[UUID, ActionRow] = {}
        self.events: list[EdgeEvent] = []
        self.resources: dict[UUID, HeldResource] = {}
        self.tombstones: dict[UUID, int] = {}
        self.told: dict[str, bool] = {}
        self.fences: dict[UUID, int] = {}

    def copy(self) -> Disk:
        """Return what a copy of the file would hold."""
        made = Disk.__new__(Disk)
        made.journal_id = self.journal_id
        made.meta = dict(self.meta)
        made.actions = dict(self.actions)
        made.events = list(self.events)
        made.resources = dict(self.resources)
        made.tombstones = dict(self.tombstones)
        made.told = dict(self.told)
        made.fences = dict(self.fences)
        return made

    @property
    def head(self) -> tuple[int, str]:
        """Sequence number and hash of the last event."""
        return (self.events[-1].seq, self.events[-1].hash) if self.events else (0, "")

    @property
    def epoch(self) -> int:
        """The session that the journal knows."""
        return int(self.meta.get("epoch", 0))

    def hash_at(self, seq: int) -> str | None:
        """Return the hash of one event."""
        if seq == 0:
            return ""
        return self.events[seq - 1].hash if seq <= len(self.events) else None

    def host_state(self, boot_id: str) -> HostState:
        """Return what decides whether anything may start."""
        return state_of(self.meta, boot_id)

    def rows(self, state: ActionState) -> list[ActionRow]:
        """Return the actions in a state, in dispatch order."""
        found = [row for row in self.actions.values() if row.st is state]
        return sorted(found, key=lambda row: row.dseq) if len(found) > 1 else found

    def open_now(self) -> list[ActionRow]:
        """Return the actions that have not ended, in dispatch order."""
        found = [row for row in self.actions.values() if row.st in OPEN]
        return sorted(found, key=lambda row: row.dseq)

    def state_of(self, action_id: UUID) -> ActionState | None:
        """Return where an action stands."""
        row = self.actions.get(action_id)
        return None if row is None else row.st

    def blocked_by(self, device_id: UUID) -> str | None:
        """Return the action in doubt that closes a device."""
        for row in self.actions.values():
            if row.st is ActionState.IN_DOUBT and row.device_id == device_id:
                return str(row.action_id)
        return None


class MemoryWrite:
    """One atomic write: `labweb.domain.runs.host_journal.journal_rows.JournalWrite` in memory."""

    def __init__(self, disk: Disk, at: HostMoment, on_commit: Callable[[bool], None]) -> None:
        self._disk = disk
        self._at = at
        self._on_commit = on_commit
        self._undo: list[tuple[dict[Any, Any], Any, Any]] = []
        self._event_count = len(disk.events)
        self.is_binding = False

    def __enter__(self) -> MemoryWrite:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            for table, key, old in reversed(self._undo):
                if old is _MISSING:
                    del table[key]
                else:
                    table[key] = old
            del self._disk.events[self._event_count :]
            return
        self._on_commit(len(self._disk.events) > self._event_count)

    def _put(self, table: dict[Any, Any], key: Any, value: Any) -> None:  # noqa: ANN401
        self._undo.append((table, key, table.get(key, _MISSING)))
        table[key] = value

    @property
    def head(self) -> tuple[int, str]:
        return self._disk.head

    def append(self, kind: str, action_id: UUID | None, body: dict[str, Any]) -> None:
        seq, prev = self._disk.head
        fields = (seq + 1, prev, kind, action_id, self._at, body)
        bare = _event(fields, "")
        made = _event(fields, event_hash(self._disk.journal_id, prev, bare))
        self._disk.events.append(made)
        self.is_binding = self.is_binding or kind == "started"

    def meta(self) -> dict[str, str]:
        return dict(self._disk.meta)

    def set_meta(self, key: str, value: str | None) -> None:
        table = self._disk.meta
        if value is not None:
            self._put(table, key, value)
        elif key in table:
            # Put first, so that the undo finds a key to give its old value.
            old = table.pop(key)
            self._undo.append((table, key, old))

    def host_state(self, boot_id: str) -> HostState:
        return state_of(self._disk.meta, boot_id)

    def action(self, action_id: UUID) -> ActionRow | None:
        return self._disk.actions.get(action_id)

    def state_of(self, action_id: UUID) -> ActionState | None:
        row = self._disk.actions.get(action_id)
        return None if row is None else row.st

    def open_rows(self) -> list[ActionRow]:
        return self._disk.open_now()

    def insert_action(self, row: ActionRow) -> None:
        if row.action_id in self._disk.actions:
            raise JournalError(f"action {row.action_id} is known")
        self._put(self._disk.actions, row.action_id, row)

    def move(
        self, action_id: UUID, before: ActionState, after: ActionState, **kept: dict[str, Any]
    ) -> None:
        row = self._disk.actions.get(action_id)
        if row is None or row.st is not before:
            raise JournalError(
                f"action {action_id} is not {before.value}", code="journal.lost_claim"
            )
        fields: dict[str, Any] = {name: canonical(value).decode() for name, value in kept.items()}
        self._put(self._disk.actions, action_id, replace(row, st=after, **fields))

    def want_cancel(self, action_id: UUID) -> None:
        row = self._disk.actions[action_id]
        self._put(self._disk.actions, action_id, replace(row, is_cancel_wanted=True))

    def blocked_by(self, device_id: UUID) -> str | None:
        return self._disk.blocked_by(device_id)

    def max_fence(self, device_id: UUID) -> int:
        return self._disk.fences.get(device_id, 0)

    def raise_fence(self, device_id: UUID, dseq: int) -> None:
        self._put(self._disk.fences, device_id, max(dseq, self.max_fence(device_id)))

    def is_tombstoned(self, action_id: UUID) -> bool:
        return action_id in self._disk.tombstones

    def add_tombstone(self, action_id: UUID, dseq: int) -> bool:
        if action_id in self._disk.tombstones:
            return False
        self._put(self._disk.tombstones, action_id, dseq)
        return True

    def is_first_refusal(self, subject: str) -> bool:
        if subject in self._disk.told:
            return False
        self._put(self._disk.told, subject, True)
        return True

    def resource(self, resource_id: UUID) -> HeldResource | None:
        return self._disk.resources.get(resource_id)

    def put_resource(self, held: HeldResource) -> None:
        self._put(self._disk.resources, held.view.id, held)

    def drop_resource(self, resource_id: UUID) -> None:
        old = self._disk.resources.pop(resource_id, None)
        if old is not None:
            self._undo.append((self._disk.resources, resource_id, old))

    def quarantined_for(self, action_id: UUID) -> list[HeldResource]:
        text = str(action_id)
        found = [one for one in self._disk.resources.values() if one.quarantined_by == text]
        return sorted(found, key=lambda one: one.view.id)


def _event(
    fields: tuple[int, str, str, UUID | None, HostMoment, dict[str, Any]], digest: str
) -> EdgeEvent:
    seq, prev, kind, action_id, at, body = fields
    return EdgeEvent(
        seq=seq, prev_hash=prev, hash=digest, kind=kind, action_id=action_id, body=body,
        at_s=at.wall_s, mono_s=at.mono_s, boot_id=at.boot_id,
    )  # fmt: skip
