"""What an edge host remembers: the rows of its journal, and the witness outside of it.

The rules write through `JournalWrite`, one atomic and durable write; the product keeps it in
SQLite, the simulator in memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol
from uuid import UUID

import msgspec

from labweb.domain.crutd.operations import Operation, from_json
from labweb.domain.errors import LabError
from labweb.domain.messages.commands import Do, ResourceView, decode_command
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.runs.host_journal.action_states import ActionState, HostState


class JournalError(LabError):
    """The journal cannot be read or written: nothing may be actuated."""

    default_code = "journal.unusable"


@dataclass(frozen=True, kw_only=True)
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

    @property
    def signed(self) -> Signed:
        """Return the command as it came."""
        return Signed(body=self.body, key_id=self.key_id, signature=self.signature)

    @cached_property
    def do(self) -> Do:
        """The command, read from its signed text."""
        command = decode_command(self.body)
        if not isinstance(command, Do):
            raise JournalError(f"action {self.action_id} holds a {type(command).__name__}")
        return command

    @cached_property
    def operation(self) -> Operation:
        """What it is to do to matter."""
        return from_json(self.do.operation)


class HeldResource(msgspec.Struct, frozen=True, kw_only=True):
    """A resource as this host knows it."""

    view: ResourceView
    quarantined_by: str | None = None


class JournalWrite(Protocol):
    """One atomic write to the journal: rows and the events that tell of them."""

    @property
    def head(self) -> tuple[int, str]:
        """Sequence number and hash of the last event; (0, "") when there is none."""

    def append(self, kind: str, action_id: UUID | None, body: dict[str, Any]) -> None:
        """Append an event to the hash chain."""

    def meta(self) -> dict[str, str]:
        """Return all remembered values of the host."""

    def set_meta(self, key: str, value: str | None) -> None:
        """Remember a value; None forgets it."""

    def host_state(self, boot_id: str) -> HostState:
        """Return what decides whether anything may start, as of this write."""

    def action(self, action_id: UUID) -> ActionRow | None:
        """Return one action, or None."""

    def state_of(self, action_id: UUID) -> ActionState | None:
        """Return where an action stands as of this write, or None."""

    def open_rows(self) -> list[ActionRow]:
        """Return the actions that have not ended, in dispatch order."""

    def insert_action(self, row: ActionRow) -> None:
        """Keep a new action; one that is known is refused with a JournalError."""

    def move(
        self, action_id: UUID, before: ActionState, after: ActionState, **kept: dict[str, Any]
    ) -> None:
        """Take an action from one state to the next, if it is in the first.

        With it goes what is to be kept of it until it ends: `prestate` or `report`.
        """

    def want_cancel(self, action_id: UUID) -> None:
        """Remember that a running action shall be stopped."""

    def blocked_by(self, device_id: UUID) -> str | None:
        """Return the action in doubt that closes a device, or None."""

    def max_fence(self, device_id: UUID) -> int:
        """Return the highest dispatch that has started on a device."""

    def raise_fence(self, device_id: UUID, dseq: int) -> None:
        """Let no earlier dispatch start on a device any more."""

    def is_tombstoned(self, action_id: UUID) -> bool:
        """Say whether an action was cancelled before it arrived."""

    def add_tombstone(self, action_id: UUID, dseq: int) -> bool:
        """Let an action that has not arrived never start; False: that was known."""

    def is_first_refusal(self, subject: str) -> bool:
        """Remember a refusal; False: it is on record, and is not told again."""

    def resource(self, resource_id: UUID) -> HeldResource | None:
        """Return a resource as this host knows it, or None."""

    def put_resource(self, held: HeldResource) -> None:
        """Keep a resource."""

    def drop_resource(self, resource_id: UUID) -> None:
        """Forget a resource that another host owns from here on."""

    def quarantined_for(self, action_id: UUID) -> list[HeldResource]:
        """Return the resources that an action in doubt has closed, in id order."""


# --- the witness --------------------------------------------------------------------


class Seal(msgspec.Struct, frozen=True, kw_only=True):
    """Identity and end of a journal, kept outside of it."""

    journal_id: UUID
    seq: int
    hash: str


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalChain:
    """A journal as its seal sees it."""

    journal_id: UUID
    seq: int
    hash_at_seal: str | None
    """Hash of the event that the seal names; None: the journal has no such event."""


def find_regression(chain: JournalChain, seal: Seal | None) -> str | None:
    """Say why a journal cannot be the newest one; None when nothing tells against it.

    A journal that was put back from a copy and has grown since is longer than its seal, so
    the sealed event itself has to be there.
    """
    if seal is None:
        return "the seal is gone" if chain.seq else None
    if seal.journal_id != chain.journal_id:
        return f"the seal belongs to journal {seal.journal_id}"
    if seal.seq > chain.seq:
        return f"the seal says {seal.seq}, the journal ends at {chain.seq}"
    if chain.hash_at_seal != seal.hash:
        return f"event {seal.seq} is not the one that was sealed"
    return None


def is_raised(found: Seal, wanted: Seal, *, hash_at_found: str | None) -> bool:
    """Say whether a seal moves on to where its journal ends.

    It never goes back, and only the journal that holds the sealed event moves it: one that
    was put back from a copy must not wipe out the evidence against itself.

    Args:
        found: The seal as it is.
        wanted: The end of the journal.
        hash_at_found: Hash of the journal's event that `found` names; None: it has none.

    Raises:
        JournalError: The seal belongs to another journal.
    """
    if found.journal_id != wanted.journal_id:
        raise JournalError(f"the seal is of journal {found.journal_id}, not {wanted.journal_id}")
    return wanted.seq > found.seq and hash_at_found == found.hash
