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
    Cancel,
    Do,
    EdgeEvent,
    Events,
    Hello,
    Resolve,
    Resume,
    Signed,
    Welcome,
)
from labweb.domain.runs import edge, intake, isolation, job, locks, relay, scheduler, session
from labweb.domain.runs.job import JobState, Mover
from labweb.domain.runs.session import SessionState
from tests.simulation.host import Link
from tests.simulation.lab import ACTION, BENCH, id_of
from tests.simulation.record import Record
from tests.simulation.rows import Attempt, Host, Job, Row


class SimServer(Record):
    """Jobs, hosts, vessels and the outbox."""

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
