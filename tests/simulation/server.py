"""The server of the simulation: rows in memory around the same rules that the services call.

Each public method is one database transaction: it happens whole or not at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.crutd import decide, lifecycle, operations
from labweb.domain.crutd.decide import Outcome, OutcomeKind
from labweb.domain.errors import LabError
from labweb.domain.messages import (
    Ack,
    BatchPart,
    Cancel,
    Command,
    Do,
    EdgeEvent,
    Events,
    Hello,
    Resolve,
    Resume,
    Signed,
    Welcome,
)
from labweb.domain.runs import (
    batch,
    edge,
    intake,
    isolation,
    job,
    locks,
    recovery,
    relay,
    scheduler,
    session,
)
from labweb.domain.runs.job import JobState, Mover
from labweb.domain.runs.session import SessionState
from tests.simulation.host import Link
from tests.simulation.lab import ACTION, BATCH, BENCH, id_of
from tests.simulation.record import Record
from tests.simulation.rows import Attempt, Host, Job, Row

MOST_TRIES = 6
"""Tries of one job in a schedule."""


def _signed(made: Command | relay.BatchDraft, epoch: int) -> tuple[Signed, Command]:
    if isinstance(made, relay.BatchDraft):
        command: Command = relay.signed_batch(made, epoch, lambda one: _signed(one, epoch)[0])
    else:
        command = relay.stamped(made, epoch)
    body = msgspec.json.encode(command).decode()
    return Signed(body=body, key_id="k", signature=""), command


class SimServer(Record):
    """Jobs, hosts, vessels and the outbox."""

    # --- scheduling ---

    def tick(self) -> None:
        """Do what the dispatcher does in one turn."""
        self.isolate()
        online = {i for i, host in self.hosts.items() if host.state is SessionState.ONLINE}
        for run in {one.run for one in self.jobs if one.state is JobState.QUEUED}:
            members = [one for one in self.jobs if one.run == run]
            views = [one.view for one in members]
            if members[0].policy is not None:
                for found in batch.find_batches(views, online):
                    self.dispatch_batch([self.by_index[view.index] for view in found])
                continue
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
        wanted = self._free_locks([made])
        if wanted is None:
            return
        findings = decide.check(made.operation, self.snapshot(made.operation))
        if findings:
            self.watch.say(f"job {made.index} is held: {findings[0].message}")
            self.move(made, JobState.HELD, Mover.SERVER)
            return
        host = self.host(made.host)
        attempt = self._attempt(made, wanted)
        host.outbox.append(Row(self._command(host, attempt), attempt.id, "do"))
        self.move(made, JobState.DISPATCHED, Mover.SCHEDULER)
        self.watch.dispatched(attempt)

    def dispatch_batch(self, members: list[Job]) -> None:
        """Do the same for all that a host does of a run, or for none of it."""
        wanted = self._free_locks(members)
        if wanted is None:
            return
        indices = {made.index for made in members}
        for made in members:
            is_first = indices.isdisjoint(made.after)
            if is_first and decide.check(made.operation, self.snapshot(made.operation)):
                self.move(made, JobState.HELD, Mover.SERVER)
                return
        bench = (id_of(BENCH),)
        claims = [locks.lock_set(m.targets, dict.fromkeys(m.targets, bench)) for m in members]
        self.batch_count += 1
        batch_id = id_of(BATCH, self.batch_count)
        host = self.host(members[0].host)
        made_here: dict[int, Attempt] = {}
        commands = []
        for made, claim, share in zip(members, claims, batch.shares(claims, wanted), strict=True):
            attempt = self._attempt(made, tuple(share))
            attempt.batch_id = batch_id
            attempt.needed = frozenset(lock.resource_id for lock in claim)
            made_here[made.index] = attempt
            part = BatchPart(
                batch_id=batch_id,
                after=[made_here[i].id for i in made.after if i in made_here],
                on_disconnect=made.policy.on_disconnect if made.policy else "",
                max_offline_s=made.policy.max_offline_s if made.policy else 0.0,
            )
            command = self._command(host, attempt)
            commands.append(msgspec.structs.replace(command, batch=part, resources=[]))
        touched = {i for made in members for i in operations.touched_ids(made.operation)}
        draft = relay.BatchDraft(
            batch_id=batch_id,
            members=commands,
            resources=[self.vessels[vessel].view for vessel in sorted(touched)],
        )
        host.outbox.append(Row(draft, batch_id, "batch"))
        for made in members:
            self.move(made, JobState.DISPATCHED, Mover.SCHEDULER)
            self.watch.dispatched(made.actions[-1])

    def _free_locks(self, members: list[Job]) -> tuple[locks.Lock, ...] | None:
        """Return the locks that jobs of one run need together; None: they are not free."""
        holders = scheduler.held_by_steps(
            scheduler.StepJob(
                run_id=id_of(0, one.run),
                step_id=one.host,
                state=one.state,
                has_started=one.has_started,
                locks=one.targets,
            )
            for one in self.jobs
            if one.run != members[0].run
        )
        targets = frozenset().union(*(made.targets for made in members))
        if any(target in holders for target in targets):
            return None
        bench = (id_of(BENCH),)
        wanted = locks.lock_set(targets, dict.fromkeys(targets, bench))
        held = [lock for one in self.attempts.values() for lock in one.locks]
        return None if locks.conflicts(wanted, held) else wanted

    def _attempt(self, made: Job, share: tuple[locks.Lock, ...]) -> Attempt:
        host = self.host(made.host)
        host.record = replace(host.record, last_dseq=host.record.last_dseq + 1)
        attempt = Attempt(
            id=id_of(ACTION, made.index * 8 + len(made.actions) + 1),
            job=made,
            dseq=host.record.last_dseq,
            targets=made.targets,
            locks=share,
        )
        made.actions.append(attempt)
        self.attempts[attempt.id] = attempt
        return attempt

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

    def publish(self, host: Host) -> None:
        """Ring for every command that is not answered."""
        for row in host.outbox:
            ago_s = None if row.sent_at_s is None else self.watch.now_s - row.sent_at_s
            if not row.is_answered and relay.is_due(host.state, ago_s):
                row.sent_at_s = self.watch.now_s
                self.watch.ring(host.name, *_signed(row.command, host.record.epoch))
        if len(host.outbox) > 24:
            host.outbox = [row for row in host.outbox if not row.is_answered]

    # --- people ---

    def cancel(self, made: Job) -> None:
        """Stop what has not begun; ask the host about what it was given."""
        if made.state in job.UNSTARTED:
            self.move(made, JobState.STOPPED, Mover.SERVER)
        elif made.state in job.AT_EDGE:
            self._post(made.actions[-1], Cancel, "cancel", {})

    def recall(self, run: int) -> None:
        """Pause a run: ask for what its hosts have not begun."""
        for made in self.jobs:
            if made.run == run and made.state in {JobState.DISPATCHED, JobState.ACCEPTED}:
                self._post(made.actions[-1], Cancel, "cancel", {"is_recall": True})

    def resume(self, run: int) -> None:
        """Queue what was given back."""
        for made in self.jobs:
            if made.run == run and made.state is JobState.HELD:
                self.move(made, JobState.QUEUED, Mover.SERVER)

    def retry(self, made: Job) -> None:
        """Try a job anew that ended undone: another action of the same intent."""
        if recovery.may_retry(made.state) and len(made.actions) < MOST_TRIES:
            self.move(made, JobState.QUEUED, Mover.PERSON)

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

    def readmit(self, host: Host) -> None:
        """Let a host begin again, after a person took stock and set its journal aside."""
        host.record = session.readmitted(host.record)
        host.state = SessionState.ISOLATED
        host.log = []
        for row in host.outbox:
            row.is_answered = True

    def sign_fence(self, name: str, actor: str) -> None:
        """Sign that a host is lost; the second person's signature fences it."""
        host = self.host(name)
        if session.check_fence(host.state, host.first_signature, actor) is not None:
            return
        if host.first_signature is None:
            host.first_signature = actor
            return
        self.watch.signed(host, {host.first_signature, actor})
        was_quarantined = bool(host.record.quarantine)
        host.record = session.fenced(host.record)
        host.state = SessionState.FENCED
        host.first_signature = None
        if not was_quarantined:
            self._fence(host, session.FENCED_CODE)

    # --- the uplink ---

    def hear(self, link: Link, frame: object) -> None:
        """Take one frame of a host."""
        if isinstance(frame, Hello):
            self.open_session(link, frame)
        elif isinstance(frame, Events):
            self._take_events(self.host(link.name), link, frame)

    def open_session(self, link: Link, hello: Hello) -> None:
        host = self.hosts[hello.host_id]
        is_live = host.state in {SessionState.ONLINE, SessionState.SYNCING}
        live = host.live_instance if is_live else ""
        answer = session.decide_hello(host.record, hello, live_instance_id=live)
        if answer.kind == "refuse":
            self.tickets.append(answer.code)
            link.is_closed_at_server = True
            return
        host.live_instance = hello.instance_id
        host.first_signature = None
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
        host.record = session.heard(host.record)
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
                session.heard(host.record), acked_seq=last.seq, hash_at_acked=last.hash
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
        self._take_event(host, event)
        attempt = self.attempts.get(event.action_id) if event.action_id else None
        if attempt is not None and attempt.batch_id is not None:
            # A batch is taken whole: what one member's event says is true of all.
            members = [one for one in self.attempts.values() if one.batch_id == attempt.batch_id]
            if all(one.job.state is not JobState.DISPATCHED for one in members):
                for row in host.outbox:
                    if row.action_id == attempt.batch_id:
                        row.is_answered = True

    def _take_event(self, host: Host, event: EdgeEvent) -> None:
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
