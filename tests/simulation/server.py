"""The server of the simulation: rows in memory around the same rules that the services call.

Each public method is one database transaction: it happens whole or not at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol
from uuid import UUID

import msgspec

from labweb.domain.crutd import decide, lifecycle, operations
from labweb.domain.crutd.decide import Change, Outcome, OutcomeKind, ResourceState
from labweb.domain.crutd.lifecycle import TransactionState
from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.errors import LabError, StateError
from labweb.domain.messages import (
    Ack,
    Cancel,
    Command,
    Do,
    EdgeEvent,
    Events,
    Hello,
    Resolve,
    ResourceView,
    Resume,
    Signed,
    Welcome,
)
from labweb.domain.resources.contents import add, remove
from labweb.domain.runs import edge, intake, isolation, job, locks, relay, scheduler, session
from labweb.domain.runs.job import JobState, Mover
from labweb.domain.runs.locks import Lock
from labweb.domain.runs.session import HostRecord, SessionState
from tests.simulation.host import Link
from tests.simulation.lab import ACTION, BENCH, HOSTS, OWNER, host_id, id_of, vessels

EVENTS_WITHOUT_JOB = frozenset({"boot", "armed"})


@dataclass(eq=False)
class Job:
    """One job, and its only try."""

    id: UUID
    index: int
    run: int
    host: str
    device_id: UUID
    operation: TransferLiquid
    after: tuple[int, ...]
    state: JobState = JobState.QUEUED
    has_started: bool = False
    actions: list[Attempt] = field(default_factory=list)

    targets: frozenset[UUID] = field(init=False)
    seen: scheduler.JobView | None = None

    def __post_init__(self) -> None:
        touched = (self.operation.source_id, self.operation.target_id)
        self.targets = frozenset({self.device_id, *touched})

    @property
    def view(self) -> scheduler.JobView:
        if self.seen is None or self.seen.state is not self.state:
            self.seen = scheduler.JobView(
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


@dataclass(eq=False)
class Row:
    """A command in the outbox."""

    command: Command
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

    def ingested(self, host: Host, fresh: Sequence[EdgeEvent]) -> None:
        """Events were written down."""

    def ring(self, host: str, signed: Signed, command: Command) -> None:
        """A doorbell rings."""

    def say(self, text: str) -> None:
        """Write a line of the trace."""


class SimServer:
    """Jobs, hosts, vessels and the outbox."""

    def __init__(self, watch: Watch) -> None:
        self.watch = watch
        self.jobs: list[Job] = []
        self.by_index: dict[int, Job] = {}
        self.attempts: dict[UUID, Attempt] = {}
        self.vessels = {view.id: Vessel(view) for view in vessels()}
        self.tickets: list[str] = []
        self.hosts = {
            host_id(name): Host(
                name=name,
                record=HostRecord(
                    host_id=host_id(name), journal_id=None, acked_seq=0, hash_at_acked="", epoch=0
                ),
            )
            for name in HOSTS
        }

    def host(self, name: str) -> Host:
        return self.hosts[host_id(name)]

    def add_job(self, made: Job) -> None:
        self.jobs.append(made)
        self.by_index[made.index] = made

    def move(self, job_: Job, state: JobState, mover: Mover) -> None:
        job.check_step(job_.state, state, mover)
        before, job_.state = job_.state, state
        if state is JobState.RUNNING:
            job_.has_started = True
        self.watch.moved(job_, before, mover)

    # --- scheduling ---

    def tick(self) -> None:
        """Do what the dispatcher does in one turn."""
        self.isolate()
        online = {i for i, host in self.hosts.items() if host.state is SessionState.ONLINE}
        for run in {one.run for one in self.jobs if one.state is JobState.QUEUED}:
            views = [one.view for one in self.jobs if one.run == run]
            for view in scheduler.ready(views, online):
                self.dispatch(self.by_index[view.index])
        for host in self.hosts.values():
            self.publish(host)

    def watch_hosts(self) -> None:
        """See who has fallen silent, by this server's monotonic clock."""
        for host in self.hosts.values():
            host.state = session.state_by_silence(host.state, self.watch.now_s - host.beat_at_s)

    def isolate(self) -> None:
        """Suspend and release jobs by the states of their hosts."""
        states = {i: host.state for i, host in self.hosts.items()}
        is_any_away = not isolation.AWAY.isdisjoint(states.values())
        if not is_any_away and all(one.state is not JobState.SUSPENDED for one in self.jobs):
            return
        for run in {one.run for one in self.jobs}:
            views = [one.view for one in self.jobs if one.run == run]
            waiting = isolation.find_waiting(views, states)
            if waiting.suspend or waiting.release:
                found = {one.id: one for one in self.jobs}
                for job_id in waiting.suspend:
                    self.move(found[job_id], JobState.SUSPENDED, Mover.SERVER)
                for job_id in waiting.release:
                    self.move(found[job_id], JobState.QUEUED, Mover.SERVER)

    def dispatch(self, made: Job) -> None:
        """Lock, write the attempt and its command; publish later."""
        holders = scheduler.held_by_steps(
            scheduler.StepJob(
                run_id=id_of(0, one.run),
                step_id=one.host,
                state=one.state,
                has_started=one.has_started,
                locks=one.targets,
            )
            for one in self.jobs
            if one.run != made.run
        )
        targets = made.targets
        if any(target in holders for target in targets):
            return
        bench = (id_of(BENCH),)
        wanted = locks.lock_set(targets, dict.fromkeys(targets, bench))
        held = [lock for one in self.attempts.values() for lock in one.locks]
        if locks.conflicts(wanted, held):
            return
        findings = decide.check(made.operation, self.snapshot(made.operation))
        if findings:
            self.watch.say(f"job {made.index} is held: {findings[0].message}")
            self.move(made, JobState.HELD, Mover.SERVER)
            return
        host = self.host(made.host)
        host.record = replace(host.record, last_dseq=host.record.last_dseq + 1)
        attempt = Attempt(
            id=id_of(ACTION, made.index * 8 + len(made.actions) + 1),
            job=made,
            dseq=host.record.last_dseq,
            targets=targets,
            locks=wanted,
        )
        made.actions.append(attempt)
        self.attempts[attempt.id] = attempt
        host.outbox.append(Row(self._command(host, attempt), attempt.id, "do"))
        self.move(made, JobState.DISPATCHED, Mover.SCHEDULER)
        self.watch.dispatched(attempt)

    def _command(self, host: Host, attempt: Attempt) -> Do:
        made = attempt.job
        touched = operations.touched_ids(made.operation)
        return Do(
            host_id=host.record.host_id,
            epoch=host.record.epoch,
            dseq=attempt.dseq,
            action_id=attempt.id,
            job_id=made.id,
            run_id=id_of(0, made.run),
            attempt=len(made.actions),
            line="line",
            device_id=made.device_id,
            driver_digest="d",
            action="stroke",
            args={},
            operation=operations.to_json(made.operation),
            resources=[self.vessels[vessel].view for vessel in touched],
        )

    def snapshot(self, operation: TransferLiquid) -> dict[UUID, ResourceState]:
        found = {}
        for vessel_id in operations.touched_ids(operation):
            vessel = self.vessels[vessel_id]
            view = vessel.view
            found[vessel_id] = ResourceState(
                id=view.id,
                name=view.name,
                kind=view.kind,
                contents=dict(view.contents),  # type: ignore[arg-type]
                capacity_nl=view.capacity_nl,
                quarantined_by=vessel.quarantined_by,
            )
        return found

    def publish(self, host: Host) -> None:
        """Ring for every command that is not answered."""
        for row in host.outbox:
            ago_s = None if row.sent_at_s is None else self.watch.now_s - row.sent_at_s
            if not row.is_answered and relay.is_due(host.state, ago_s):
                row.sent_at_s = self.watch.now_s
                command = relay.stamped(row.command, host.record.epoch)
                body = msgspec.json.encode(command).decode()
                signed = Signed(body=body, key_id="k", signature="")
                self.watch.ring(host.name, signed, command)
        if len(host.outbox) > 24:
            host.outbox = [row for row in host.outbox if not row.is_answered]

    # --- people ---

    def cancel(self, made: Job) -> None:
        """Stop what has not begun; ask the host about what it was given."""
        if made.state in job.UNSTARTED:
            self.move(made, JobState.STOPPED, Mover.SERVER)
        elif made.state in job.AT_EDGE:
            self._post(made.actions[-1], Cancel, "cancel", {})

    def resolve(self, made: Job, answer: str, moved_nl: int | None) -> None:
        """Take a person's answer: to its host, or here where the host can never tell."""
        attempt = made.actions[-1]
        host = self.host(made.host)
        if session.is_given_up(host.record, attempt.dseq):
            found = edge.resolve(answer, moved_nl=moved_nl)
            assert found is not None
            state, outcome = found
            if outcome.kind is OutcomeKind.UNKNOWN:
                self._discard(attempt, {})
            else:
                self._settle(attempt, outcome, None, None)
            self.move(made, JobState(state.value), Mover.PERSON)
            return
        rows = host.outbox
        is_asked = any(
            row.kind == "resolve" and row.action_id == attempt.id and not row.is_answered
            for row in rows
        )
        if host.record.quarantine or is_asked:
            return
        self._post(attempt, Resolve, "resolve", {"answer": answer, "moved_nl": moved_nl})

    def _post(
        self, attempt: Attempt, kind: type[Cancel | Resolve], name: str, fields: dict[str, Any]
    ) -> None:
        host = self.host(attempt.job.host)
        command = kind(
            host_id=host.record.host_id,
            epoch=host.record.epoch,
            dseq=attempt.dseq,
            action_id=attempt.id,
            **fields,
        )
        if not any(
            row.kind == name and row.action_id == attempt.id and not row.is_answered
            for row in host.outbox
        ):
            host.outbox.append(Row(command, attempt.id, name))

    def take_stock(self, vessel_id: UUID, nl: int) -> bool:
        """Write down what a person found in a closed vessel, while nothing is open on it."""
        is_open = any(vessel_id in one.targets and one.locks for one in self.attempts.values())
        if is_open:
            return False
        vessel = self.vessels[vessel_id]
        lot = f"lot {OWNER[vessel_id]}"
        view = msgspec.structs.replace(
            vessel.view, contents={lot: nl} if nl else {}, rev=vessel.view.rev + 1
        )
        self.vessels[vessel_id] = Vessel(view)
        return True

    def readmit(self, host: Host) -> None:
        """Let a host begin again, after a person took stock and set its journal aside."""
        host.record = session.readmitted(host.record)
        host.state = SessionState.ISOLATED
        host.log = []
        for row in host.outbox:
            row.is_answered = True

    # --- the uplink ---

    def hear(self, link: Link, frame: object) -> None:
        """Take one frame of a host."""
        if isinstance(frame, Hello):
            self.open_session(link, frame)
        elif isinstance(frame, Events):
            self._take_events(self.host(link.name), link, frame)

    def open_session(self, link: Link, hello: Hello) -> None:
        host = self.hosts[hello.host_id]
        answer = session.decide_hello(host.record, hello)
        opening = session.after_hello(host.record, hello, answer)
        was_quarantined = bool(host.record.quarantine)
        if host.record.journal_id != opening.record.journal_id:
            host.log = []
        host.record, host.state = opening.record, opening.state
        host.beat_at_s = self.watch.now_s
        host.is_resumed = False
        link.server_epoch = host.record.epoch
        link.pending_head = hello.seq_head
        if opening.mode == "quarantine" and not was_quarantined:
            self._fence(host, answer.code)
        link.down.append(
            Welcome(
                epoch=host.record.epoch,
                acked_seq=host.record.acked_seq,
                floor=host.record.floor,
                server_at_s=self.watch.now_s,
                mode=opening.mode,
            )
        )
        if opening.mode == "normal":
            self._maybe_resume(host, link)

    def _maybe_resume(self, host: Host, link: Link) -> None:
        if link.is_resumed or not session.is_caught_up(host.record.acked_seq, link.pending_head):
            return
        link.is_resumed = host.is_resumed = True
        if host.state in {SessionState.SYNCING, SessionState.SUSPECT, SessionState.ISOLATED}:
            host.state = SessionState.ONLINE
        link.down.append(Resume(epoch=host.record.epoch))

    def beat(self, link: Link, host: Host) -> None:
        """Take a sign of life."""
        if link.server_epoch != host.record.epoch:
            link.is_closed_at_server = True
            return
        host.beat_at_s = self.watch.now_s
        host.state = session.state_by_beat(host.state, is_resumed=link.is_resumed)

    def _take_events(self, host: Host, link: Link, frame: Events) -> None:
        if host.record.epoch != link.server_epoch or frame.epoch != link.server_epoch:
            link.is_closed_at_server = True
            return
        found = session.check_events(host.record, frame.events)
        if found.code:
            self.quarantine(host, found.code)
            link.is_closed_at_server = True
            return
        try:
            self._check_all(host, found.fresh)
        except (LabError, ValueError, KeyError) as error:
            self.quarantine(host, f"host.bad_event: {error}")
            link.is_closed_at_server = True
            return
        for event in found.fresh:
            self._apply(host, event)
        if found.fresh:
            last = found.fresh[-1]
            host.record = replace(
                host.record,
                acked_seq=last.seq,
                hash_at_acked=last.hash,
                epoch_seen=host.record.epoch,
            )
            host.log.extend(found.fresh)
            self.watch.ingested(host, found.fresh)
        link.down.append(Ack(seq=host.record.acked_seq))
        self._maybe_resume(host, link)

    def _check_all(self, host: Host, events: Sequence[EdgeEvent]) -> None:
        """Find out whether the whole frame can be applied, as a rolled-back write would."""
        states: dict[UUID, JobState] = {}
        for event in events:
            attempt = self.attempts.get(event.action_id) if event.action_id else None
            if attempt is None:
                continue
            current = states.get(attempt.id, attempt.job.state)
            meaning = intake.read_event(event.kind, event.body, current)
            states[attempt.id] = meaning.state or current

    def _apply(self, host: Host, event: EdgeEvent) -> None:
        if event.action_id is None:
            return
        attempt = self.attempts.get(event.action_id)
        if attempt is None or attempt.job.host != host.name:
            self.tickets.append("host.unknown_action")
            return
        meaning = intake.read_event(event.kind, event.body, attempt.job.state)
        for row in host.outbox:
            if row.action_id == attempt.id and row.kind in meaning.answered:
                row.is_answered = True
        if meaning.advance is not None:
            lifecycle.check_step(attempt.transaction, meaning.advance)
            attempt.transaction = meaning.advance
        if meaning.outcome is not None:
            is_discarded = meaning.is_resolution and meaning.outcome.kind is OutcomeKind.UNKNOWN
            if is_discarded:
                self._discard(attempt, event.body.get("revs") or {})
            else:
                self._settle(attempt, meaning.outcome, event.body.get("change"), event.body)
        if meaning.state is not None:
            self.move(attempt.job, meaning.state, Mover.EDGE)

    # --- the record ---

    def _settle(
        self,
        attempt: Attempt,
        outcome: Outcome,
        reported: dict[str, Any] | None,
        body: Any,  # noqa: ANN401 - an event's
    ) -> None:
        operation = attempt.job.operation
        try:
            change = decide.settle(operation, self.snapshot(operation), outcome)
        except StateError as error:
            self.tickets.append(error.code)
            change = decide.settle(operation, {}, Outcome(kind=OutcomeKind.UNKNOWN))
        if reported is not None and reported != change.to_json():
            self.tickets.append("reconcile.drift")
            for vessel_id in operations.touched_ids(operation):
                self.vessels[vessel_id].quarantined_by = str(attempt.id)
        lifecycle.check_step(attempt.transaction, change.state)
        self._write(attempt, change, (body or {}).get("revs") or {})
        self._close(attempt, change.state, is_freed=True)

    def _write(self, attempt: Attempt, change: Change, revs: dict[str, int]) -> None:
        touched = set(change.quarantined)
        for posting in change.postings:
            parts = {posting.lot: posting.amount_nl}
            for account, pour in ((posting.debit, remove), (posting.credit, add)):
                vessel = self.vessels[UUID(account)]
                left = pour(vessel.view.contents, parts)  # type: ignore[arg-type]
                vessel.view = msgspec.structs.replace(vessel.view, contents=left)
                touched.add(UUID(account))
        for vessel_id in change.quarantined:
            self.vessels[vessel_id].quarantined_by = str(attempt.id)
        self._set_revs(revs or {str(i): self.vessels[i].view.rev + 1 for i in touched})

    def _set_revs(self, revs: dict[str, int]) -> None:
        for key, rev in revs.items():
            vessel = self.vessels[UUID(key)]
            vessel.view = msgspec.structs.replace(vessel.view, rev=rev)

    def _close(self, attempt: Attempt, state: TransactionState, *, is_freed: bool) -> None:
        was_quarantined = attempt.transaction is TransactionState.QUARANTINED
        attempt.transaction = state
        if state not in lifecycle.FINAL:
            return
        attempt.locks = ()
        if was_quarantined and is_freed:
            for vessel in self.vessels.values():
                if vessel.quarantined_by == str(attempt.id):
                    vessel.quarantined_by = None

    def _discard(self, attempt: Attempt, revs: dict[str, int]) -> None:
        lifecycle.check_step(attempt.transaction, TransactionState.ROLLED_BACK)
        self._set_revs(revs)
        self._close(attempt, TransactionState.ROLLED_BACK, is_freed=False)

    # --- quarantine ---

    def quarantine(self, host: Host, code: str) -> None:
        """Fence a host whose log cannot be trusted."""
        was_quarantined = bool(host.record.quarantine)
        host.record = session.quarantined(host.record, code)
        host.state = SessionState.QUARANTINED
        if not was_quarantined:
            self._fence(host, code)

    def _fence(self, host: Host, code: str) -> None:
        self.watch.fenced(host, code)
        self.tickets.append(code)
        for made in self.jobs:
            if made.host == host.name and made.state in job.AT_EDGE:
                self._settle(made.actions[-1], Outcome(kind=OutcomeKind.UNKNOWN), None, None)
                self.move(made, JobState.IN_DOUBT, Mover.FENCE)
