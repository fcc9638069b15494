"""Which jobs may be dispatched now, and what becomes of the run."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from uuid import UUID

from labweb.domain.runs.states.job_states import AT_EDGE, FINAL, UNSTARTED, JobState, RunState


@dataclass(frozen=True, slots=True, kw_only=True)
class JobView:
    """What scheduling needs to know of a job."""

    id: UUID
    index: int
    state: JobState
    after: tuple[int, ...]
    """Jobs of the run that come before; every index is lower than its own."""

    host_id: UUID
    meets: int | None = None
    """Job that begins at the same moment: both are sent together, or none is."""

    owner_ids: frozenset[UUID] = frozenset()
    """Hosts that own what the job uses, beside its own."""

    choice_host_ids: frozenset[UUID] = frozenset()
    """Hosts of the devices of which the first that is free does it; empty: its own alone."""

    is_carry: bool = False
    """It carries a thing, which may have to change hands before and after: it goes alone."""

    is_asking: bool = False
    """A person has to confirm it before it is sent, and nobody has yet."""

    is_passed: bool = False
    """A person said that the run goes on, though the job ended undone."""

    is_taken_away: bool = False
    """A halt undid what it had set, and no person has answered for it yet."""

    @property
    def host_ids(self) -> frozenset[UUID]:
        """Return the hosts of which one is enough."""
        return self.choice_host_ids or frozenset({self.host_id})

    @property
    def is_satisfied(self) -> bool:
        """Say whether what comes after it may go."""
        return self.state is JobState.COMPLETE or (self.is_passed and self.state in FINAL)


SILENT_AFTER_S = 180.0
"""A device that has told nothing for so long is not taken while another one is free."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceCandidate:
    """One of several devices that may do a job, when its turn comes."""

    state: str
    """Of its enrollment; `enrolled` alone may act."""

    host_name: str
    is_host_online: bool
    is_on_planned_host: bool
    silent_s: float | None
    """Since it told anything; None: it never has, as one that has no status."""


def why_passed_by(one: DeviceCandidate) -> str:
    """Say why a device is not asked to do a job; "": it is asked, and its locks decide."""
    if one.state != "enrolled":
        return f"it is {one.state}"
    if not one.is_on_planned_host:
        return "it was taken to another host since this was planned"
    if not one.is_host_online:
        return f"{one.host_name} is away"
    if one.silent_s is not None and one.silent_s > SILENT_AFTER_S:
        return "it has told nothing for minutes"
    return ""


def ready(jobs: Sequence[JobView], online_hosts: Collection[UUID]) -> list[JobView]:
    """Return the queued jobs whose predecessors completed and of whose hosts one is online.

    A job that meets another one is ready when that one is.
    """
    done = {job.index for job in jobs if job.is_satisfied}
    found = [
        job
        for job in jobs
        if job.state is JobState.QUEUED
        and not job.is_asking
        and not job.host_ids.isdisjoint(online_hosts)
        and done.issuperset(job.after)
    ]
    indices = {job.index for job in found}
    return [job for job in found if job.meets is None or job.meets in indices]


def asking(jobs: Sequence[JobView]) -> frozenset[UUID]:
    """Return the queued jobs that wait for nothing but a person who confirms them."""
    done = {job.index for job in jobs if job.is_satisfied}
    waiting = (job for job in jobs if job.is_asking and job.state is JobState.QUEUED)
    return frozenset(job.id for job in waiting if done.issuperset(job.after))


def pair_of(job: JobView, others: Sequence[JobView]) -> tuple[JobView, JobView] | None:
    """Return a job with the one that it meets, for the first of the two; None: for the second."""
    if job.meets is None or job.meets < job.index:
        return None
    other = next((one for one in others if one.index == job.meets), None)
    return None if other is None else (job, other)


def may_begin(
    jobs: Sequence[JobView], short_of_room: Collection[UUID], *, is_server_full: bool
) -> bool:
    """Say whether a run may have jobs dispatched where disks are short of room.

    One that has begun goes on to its end; one that has not waits for room on the server and on
    every host that one of its jobs may need.
    """
    if any(job.state not in UNSTARTED or job.is_passed for job in jobs):
        return True
    return not is_server_full and all(job.host_ids.isdisjoint(short_of_room) for job in jobs)


_SETTLED = FINAL | {JobState.IN_DOUBT}


def run_state(
    current: RunState,
    jobs: Sequence[JobView],
    *,
    is_given_up: bool = False,
    is_halting: bool = False,
) -> RunState:
    """Return the state of a run from the states of its jobs.

    A job in doubt, one that ended badly, or one that a halt undid pauses the run: it needs a
    person, also where nothing else is left. Complete tells a reader that every step stands as it
    was asked for, but for those that somebody passed over by name. Only a run that a person has
    given up ends as aborted: once nothing of it acts, and of each device that was to be halted
    for it is known whether it stands, or why it cannot be halted yet. What is in doubt stays so
    after its end, until a person has answered.

    Args:
        current: Where it stands.
        jobs: All its jobs.
        is_given_up: A person has given it up.
        is_halting: Of some device that is to be halted for it nothing is known yet.
    """
    if current in {RunState.COMPLETE, RunState.ABORTED, RunState.DRAFT}:
        return current
    if current is RunState.AWAITING_APPROVAL:
        return current
    if is_given_up and (is_halting or any(job.state not in _SETTLED for job in jobs)):
        return RunState.RUNNING
    states = [job.state for job in jobs if not (job.is_satisfied and job.is_passed)]
    is_undone = any(job.is_taken_away for job in jobs)
    if all(state is JobState.COMPLETE for state in states) and not is_undone:
        return RunState.COMPLETE if _is_anything_done(jobs) else RunState.ABORTED
    if is_given_up:
        return RunState.ABORTED
    is_moving = any(state in AT_EDGE for state in states)
    needs_person = is_undone or _needs_person(states)
    if is_moving:
        return RunState.PAUSING if needs_person else RunState.RUNNING
    if needs_person:
        return RunState.PAUSED
    has_begun = any(job.is_satisfied for job in jobs)
    return RunState.RUNNING if has_begun else RunState.QUEUED


def state_after_dispatch(current: RunState) -> RunState | None:
    """Return the state of a run of which one more job was sent; None: its jobs decide.

    Nothing in a run that is queued or running needs a person.
    """
    return RunState.RUNNING if current in {RunState.QUEUED, RunState.RUNNING} else None


def _is_anything_done(jobs: Sequence[JobView]) -> bool:
    return any(job.state is JobState.COMPLETE or job.is_passed for job in jobs)


def _needs_person(states: Sequence[JobState]) -> bool:
    bad = {
        JobState.IN_DOUBT,
        JobState.ABORTED,
        JobState.REJECTED,
        JobState.STOPPED,
        JobState.HELD,
    }
    return any(state in bad for state in states)
