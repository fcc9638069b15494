"""Rows of the simulated server's tables, and what looks on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol
from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid, Update, touched_ids
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.messages.commands import Command, ResourceView
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.dispatch import job_scheduler
from labweb.domain.runs.dispatch.command_outbox import BatchDraft
from labweb.domain.runs.exclusive_use.action_locks import Lock
from labweb.domain.runs.host_link.host_session import HostRecord, SessionState
from labweb.domain.runs.states.job_states import JobState, Mover
from tests.simulation.lab import host_id


@dataclass(frozen=True, slots=True)
class Policy:
    """What a run declares for its batches."""

    on_disconnect: str
    max_offline_s: float


@dataclass(eq=False)
class Job:
    """One job with its tries."""

    id: UUID
    index: int
    run: int
    host: str
    device_id: UUID
    operation: TransferLiquid | Update
    after: tuple[int, ...]
    state: JobState = JobState.QUEUED
    has_started: bool = False
    ended_tries: int = 0
    """Tries that were judged at their end, before a person had the job tried anew."""

    actions: list[Attempt] = field(default_factory=list)

    targets: frozenset[UUID] = field(init=False)
    seen: job_scheduler.JobView | None = None
    action: str = "stroke"
    halted_by: str = ""
    """Cause of the halt that has taken away what it had set; empty: it stands."""

    policy: Policy | None = None
    """How its batch behaves with the server away; None: it goes alone."""

    def __post_init__(self) -> None:
        self.targets = frozenset({self.device_id, *touched_ids(self.operation)})

    @property
    def amount_nl(self) -> int:
        """What it moves."""
        return self.operation.amount_nl if isinstance(self.operation, TransferLiquid) else 0

    @property
    def view(self) -> job_scheduler.JobView:
        if self.seen is None or self.seen.state is not self.state:
            self.seen = job_scheduler.JobView(
                id=self.id,
                index=self.index,
                state=self.state,
                after=self.after,
                host_id=host_id(self.host),
            )
        return self.seen


@dataclass(eq=False)
class Attempt:
    """One try, with the locks that it holds until it is settled."""

    id: UUID
    job: Job
    dseq: int
    targets: frozenset[UUID]
    locks: tuple[Lock, ...]
    transaction: TransactionState = TransactionState.LOCKED
    batch_id: UUID | None = None
    needed: frozenset[UUID] = frozenset()
    """Every resource that it locks, those above included."""


@dataclass(eq=False)
class Row:
    """A command in the outbox."""

    command: Command | BatchDraft
    action_id: UUID
    kind: str
    sent_at_s: float | None = None
    is_answered: bool = False


@dataclass(eq=False)
class Host:
    """What the server remembers of a host."""

    name: str
    record: HostRecord
    state: SessionState = SessionState.ENROLLING
    beat_at_s: float = 0.0
    is_resumed: bool = False
    live_instance: str = ""
    """Process whose connection is open, where the schedule gives processes names."""

    first_signature: str | None = None
    log: list[EdgeEvent] = field(default_factory=list)
    """Events applied of the present journal."""

    outbox: list[Row] = field(default_factory=list)


@dataclass
class Vessel:
    """A vessel as the server knows it."""

    view: ResourceView
    quarantined_by: str | None = None


class Watch(Protocol):
    """What looks on."""

    now_s: float

    def moved(self, job: Job, before: JobState, mover: Mover) -> None:
        """A job has changed its state."""

    def dispatched(self, attempt: Attempt) -> None:
        """A job was sent to a host."""

    def fenced(self, host: Host, code: str) -> None:
        """A host was put into quarantine."""

    def signed(self, host: Host, people: set[str]) -> None:
        """People have declared a host lost."""

    def ingested(self, host: Host, fresh: Sequence[EdgeEvent]) -> None:
        """Events were written down."""

    def ring(self, host: str, signed: Signed, command: Command) -> None:
        """A doorbell rings."""

    def say(self, text: str) -> None:
        """Write a line of the trace."""
