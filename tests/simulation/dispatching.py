"""What the simulated server sends: jobs alone or in batches, rung until they are answered."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from uuid import UUID

import msgspec

from labweb.domain.crutd import operations, settlement
from labweb.domain.messages.commands import BatchPart, Command, Do
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.runs.dispatch import command_outbox, job_scheduler, work_of_absent_host
from labweb.domain.runs.exclusive_use import action_locks
from labweb.domain.runs.host_actions import host_batch
from labweb.domain.runs.host_link import host_session
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import AT_EDGE, FINAL, JobState, Mover
from tests.simulation.lab import ACTION, BATCH, BENCH, id_of
from tests.simulation.record import Record
from tests.simulation.rows import Attempt, Host, Job, Row

AT = datetime(2026, 1, 1, tzinfo=UTC)
"""No calibration has a say in these labs: any moment does."""


def _signed(made: Command | command_outbox.BatchDraft, epoch: int) -> tuple[Signed, Command]:
    if isinstance(made, command_outbox.BatchDraft):
        sign = partial(_signed_alone, epoch=epoch)
        command: Command = command_outbox.signed_batch(made, epoch, sign, at=AT)
    else:
        command = command_outbox.stamped(made, epoch, at=AT)
    body = msgspec.json.encode(command).decode()
    return Signed(body=body, key_id="k", signature=""), command


def _signed_alone(made: Command, *, epoch: int) -> Signed:
    return _signed(made, epoch)[0]


class Dispatching(Record):
    """Scheduling, locks and the outbox."""

    # --- scheduling ---

    def tick(self) -> None:
        """Do what the dispatcher does in one turn."""
        self.isolate()
        online = {i for i, host in self.hosts.items() if host.state is SessionState.ONLINE}
        for run in {one.run for one in self.jobs if one.state is JobState.QUEUED}:
            members = [one for one in self.jobs if one.run == run]
            views = [one.view for one in members]
            if members[0].policy is not None:
                for found in host_batch.find_batches(views, online):
                    self.dispatch_batch([self.by_index[view.index] for view in found])
                continue
            for view in job_scheduler.ready(views, online):
                self.dispatch(self.by_index[view.index])
        for host in self.hosts.values():
            self.publish(host)

    def watch_hosts(self) -> None:
        """See who has fallen silent, by this server's monotonic clock."""
        for host in self.hosts.values():
            host.state = host_session.state_by_silence(
                host.state, self.watch.now_s - host.beat_at_s
            )

    def isolate(self) -> None:
        """Suspend and release jobs by the states of their hosts."""
        states = {i: host.state for i, host in self.hosts.items()}
        is_any_away = not work_of_absent_host.AWAY.isdisjoint(states.values())
        if not is_any_away and all(one.state is not JobState.SUSPENDED for one in self.jobs):
            return
        for run in {one.run for one in self.jobs}:
            views = [one.view for one in self.jobs if one.run == run]
            waiting = work_of_absent_host.find_waiting(views, states)
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
        findings = settlement.check(made.operation, self.snapshot(made.operation))
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
            if is_first and settlement.check(made.operation, self.snapshot(made.operation)):
                self.move(made, JobState.HELD, Mover.SERVER)
                return
        bench = (id_of(BENCH),)
        claims = [
            action_locks.lock_set(m.targets, dict.fromkeys(m.targets, bench)) for m in members
        ]
        self.batch_count += 1
        batch_id = id_of(BATCH, self.batch_count)
        host = self.host(members[0].host)
        made_here: dict[int, Attempt] = {}
        commands = []
        for made, claim, share in zip(
            members, claims, host_batch.shares(claims, wanted), strict=True
        ):
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
        draft = command_outbox.BatchDraft(
            batch_id=batch_id,
            members=commands,
            resources=[self.vessels[vessel].view for vessel in sorted(touched)],
        )
        host.outbox.append(Row(draft, batch_id, "batch"))
        for made in members:
            self.move(made, JobState.DISPATCHED, Mover.SCHEDULER)
            self.watch.dispatched(made.actions[-1])

    def _free_locks(self, members: list[Job]) -> tuple[action_locks.Lock, ...] | None:
        """Return the locks that jobs of one run need together; None: they are not free."""
        targets = frozenset().union(*(made.targets for made in members))
        if not self.may_hold(members):
            return None
        bench = (id_of(BENCH),)
        wanted = action_locks.lock_set(targets, dict.fromkeys(targets, bench))
        held = [lock for one in self.attempts.values() for lock in one.locks]
        return None if action_locks.conflicts(wanted, held) else wanted

    def may_hold(self, members: list[Job]) -> bool:
        """Say whether no other run is in the middle of what it does on one host with these things.

        Runs that keep things for longer are played by `tests.simulation.holding`.
        """
        held: set[UUID] = set()
        for run, host in {(one.run, one.host) for one in self.jobs if one.run != members[0].run}:
            part = [one for one in self.jobs if (one.run, one.host) == (run, host)]
            has_begun = any(one.has_started or one.state in AT_EDGE for one in part)
            if has_begun and not all(one.state in FINAL for one in part):
                held.update(*(one.targets for one in part))
        return held.isdisjoint(self.whole_of(members))

    def whole_of(self, members: list[Job]) -> frozenset[UUID]:
        """Return what has to be free of other runs for jobs to begin: here, what they touch."""
        return frozenset().union(*(made.targets for made in members))

    def _attempt(self, made: Job, share: tuple[action_locks.Lock, ...]) -> Attempt:
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
            action=made.action,
            args={},
            operation=operations.to_json(made.operation),
            resources=[self.vessels[vessel].view for vessel in touched],
        )

    def publish(self, host: Host) -> None:
        """Ring for every command that is not answered."""
        for row in host.outbox:
            ago_s = None if row.sent_at_s is None else self.watch.now_s - row.sent_at_s
            if not row.is_answered and command_outbox.is_due(host.state, ago_s):
                row.sent_at_s = self.watch.now_s
                self.watch.ring(host.name, *_signed(row.command, host.record.epoch))
        if len(host.outbox) > 24:
            host.outbox = [row for row in host.outbox if not row.is_answered]
