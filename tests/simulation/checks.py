"""What must hold after every step and at the end, judged without asking the rules."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from labweb.domain.crutd.transaction_states import FINAL as SETTLED
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.host_journal.action_states import ActionState
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import FINAL, JobState, Mover
from tests.simulation.lab import OWNER

if TYPE_CHECKING:
    from tests.simulation.host import SimHost
    from tests.simulation.rows import Attempt, Host, Job
    from tests.simulation.world import World

SENT = frozenset(
    {
        JobState.DISPATCHED,
        JobState.ACCEPTED,
        JobState.RUNNING,
        JobState.COMPLETING,
        JobState.IN_DOUBT,
    }
)
TELLERS = frozenset({Mover.EDGE, Mover.FENCE, Mover.PERSON})
WAITING_TOO_LONG_S = 35.0


class ViolationError(AssertionError):
    """An invariant does not hold."""


def require(holds: object, name: str, text: str) -> None:
    """Raise the violation of an invariant, unless it holds."""
    if not holds:
        raise ViolationError(f"{name}: {text}")


def check_move(world: World, job: Job, before: JobState, mover: Mover) -> None:
    """I2, I7, I16: who moved a job, from where, and what really happened."""
    is_retry = mover is Mover.PERSON and job.state is JobState.QUEUED
    may_leave = before not in FINAL or (is_retry and before is not JobState.COMPLETE)
    require(may_leave, "I7", f"job {job.index} left {before.value}")
    if is_retry:
        job.ended_tries = len(job.actions)
    if before in SENT:
        text = f"{mover.value} took job {job.index} from {before.value} to {job.state.value}"
        require(mover in TELLERS, "I16", text)
    if job.state in FINAL:
        check_end(world, job)


def check_end(world: World, job: Job) -> None:
    """I2: an end agrees with what the device has really done."""
    last = job.actions[job.ended_tries :]
    count = sum(world.matter.count[one.id] for one in last)
    moved_nl = sum(world.matter.moved_nl.get(one.id, 0) for one in last)
    if job.state is JobState.COMPLETE:
        require(count == 1, "I2", f"job {job.index} is complete and happened {count} times")
        whole = moved_nl == job.amount_nl
        require(whole, "I2", f"job {job.index} is complete and moved {moved_nl} nL")
    elif job.state in {JobState.REJECTED, JobState.STOPPED}:
        require(count == 0, "I2", f"job {job.index} is {job.state.value} and happened")


def check_dispatch(world: World, fresh: Attempt) -> None:
    """I9, I16: one try per job, and nothing in use is used again."""
    for one in fresh.job.actions[:-1]:
        has_ended = one.transaction in SETTLED
        require(has_ended, "I16", f"job {fresh.job.index} was sent anew before its try ended")
    for one in world.server.attempts.values():
        if one is fresh or one.transaction in SETTLED:
            continue
        if one.batch_id is not None and one.batch_id == fresh.batch_id:
            continue
        both = one.targets & fresh.targets
        require(not both, "I9", f"jobs {one.job.index} and {fresh.job.index} use the same")


def check_turn(world: World, host: SimHost, attempt: Attempt) -> None:
    """B1, B2: a member of a batch starts after what comes before it, and not behind its leash."""
    job = attempt.job
    for index in job.after:
        before = world.server.by_index[index]
        moved_nl = [world.matter.moved_nl.get(one.id, 0) for one in before.actions]
        is_whole = bool(moved_nl) and moved_nl[-1] == before.amount_nl
        require(is_whole, "B1", f"job {job.index} starts though job {index} did not happen whole")
    policy = job.policy
    if policy is None or host.lost_at_s is None:
        return
    away_s = world.now_s - host.lost_at_s
    may = policy.on_disconnect == "continue" and away_s <= policy.max_offline_s
    require(may, "B2", f"job {job.index} starts, {away_s:.0f} s after the server went away")


def check_stopped(world: World, host: SimHost) -> None:
    """B3: with the server away, nothing waits or goes on unhalted that is to stop then."""
    for row in host.disk.open_now():
        policy = world.server.attempts[row.action_id].job.policy
        if policy is not None and policy.on_disconnect == "stop_safe":
            is_safe = row.st is not ActionState.ACCEPTED
            is_safe = is_safe and (row.st is not ActionState.STARTED or row.is_cancel_wanted)
            require(is_safe, "B3", f"dispatch {row.dseq} goes on with the server away")


def check_log(host: Host, fresh: Sequence[EdgeEvent]) -> None:
    """I5: what was applied is a prefix without a gap, each event once and chained."""
    at = len(host.log) - len(fresh)
    seq, digest = (host.log[at - 1].seq, host.log[at - 1].hash) if at else (0, "")
    for event in fresh:
        require(event.seq == seq + 1, "I5", f"event {event.seq} was applied after {seq}")
        require(event.prev_hash == digest, "I5", f"event {event.seq} follows another history")
        seq, digest = event.seq, event.hash


def check_isolation(world: World) -> None:
    """I17: nothing waits in the queue for a host that has been silent for long."""
    if world.now_s - world.server_up_at_s < WAITING_TOO_LONG_S:
        return
    for host in world.server.hosts.values():
        silent_s = world.now_s - host.beat_at_s
        if host.state is SessionState.ENROLLING or silent_s < WAITING_TOO_LONG_S:
            continue
        behind: set[int] = set()
        for job in world.server.jobs:
            if job.state in FINAL:
                continue
            if job.host == host.name or not behind.isdisjoint(job.after):
                behind.add(job.index)
                text = f"job {job.index} is queued, host {host.name} is silent {silent_s:.0f} s"
                require(job.state is not JobState.QUEUED, "I17", text)


def check_quiet(world: World) -> None:
    """I2, I3, I4, I5, I6, I8, I12: everything has come to rest and tells one story."""
    for job in world.server.jobs:
        require(job.state in FINAL, "I8", f"job {job.index} is {job.state.value} for ever")
        check_end(world, job)
    _check_logs(world)
    _check_vessels(world)


def _check_logs(world: World) -> None:
    for host in world.hosts.values():
        kept = world.server.host(host.name)
        require(kept.record.journal_id == host.disk.journal_id, "I5", "another journal")
        count = len(kept.log)
        require(count == len(host.disk.events), "I5", f"{count} events of {host.name} were read")
        same = [one.hash for one in kept.log] == [one.hash for one in host.disk.events]
        require(same, "I6", f"the log of {host.name} is not what was acknowledged")


def _check_vessels(world: World) -> None:
    server = world.server
    by_lot: dict[str, int] = {}
    for vessel_id, vessel in server.vessels.items():
        view = vessel.view
        for lot, amount in view.contents.items():
            by_lot[lot] = by_lot.get(lot, 0) + amount
            require(amount > 0, "I3", f"{view.name} holds {amount} nL of {lot}")
        total = sum(view.contents.values())
        real = world.matter.nl[vessel_id]
        require(vessel.quarantined_by is None, "I8", f"{view.name} stays closed")
        text = f"{view.name} holds {real} nL, the record says {total} nL"
        require(real == total, "I4", text)
        held = world.hosts[OWNER[vessel_id]].disk.resources.get(vessel_id)
        if held is None or held.view.rev < view.rev:
            continue
        same = held.view.contents == view.contents and held.quarantined_by is None
        require(same and held.view.rev == view.rev, "I12", f"{view.name}: host and server differ")
    require(sum(by_lot.values()) == sum(world.matter.nl.values()), "I3", "liquid was made or lost")
