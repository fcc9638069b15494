"""Whose work waits while a host is away: its own, what depends on it, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from uuid import UUID

from labweb.domain.runs.dispatch.job_scheduler import JobView
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import FINAL, JobState

AWAY = frozenset(
    {
        SessionState.ISOLATED,
        SessionState.QUARANTINED,
        SessionState.FENCED,
        SessionState.REVOKED,
    }
)
"""Hosts that cannot be waited for by the second: their work is suspended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitingJobs:
    """Which jobs change their state because hosts went away or came back."""

    suspend: tuple[UUID, ...] = ()
    release: tuple[UUID, ...] = ()


def find_waiting(jobs: Sequence[JobView], hosts: Mapping[UUID, SessionState]) -> WaitingJobs:
    """Return which queued jobs of a run to suspend, and which suspended ones to queue again.

    What was dispatched is never touched: a host that is silent is not dead. A suspended
    job goes back into the queue when nothing that it depends on is away and every host it
    waits for is online, so that a host that comes and goes does not make it flicker.

    Args:
        jobs: All jobs of one run.
        hosts: State of every host.
    """
    away = {host for host, state in hosts.items() if state in AWAY}
    back = {host for host, state in hosts.items() if state is SessionState.ONLINE}
    suspended = _reached(jobs, away)
    held = _reached(jobs, set(hosts) - back)
    return WaitingJobs(
        suspend=tuple(
            job.id for job in jobs if job.state is JobState.QUEUED and job.index in suspended
        ),
        release=tuple(
            job.id for job in jobs if job.state is JobState.SUSPENDED and job.index not in held
        ),
    )


def _reached(jobs: Sequence[JobView], hosts: set[UUID]) -> set[int]:
    """Return the unfinished jobs of these hosts and all that follow from them."""
    found: set[int] = set()
    for job in sorted(jobs, key=lambda one: one.index):
        if job.state in FINAL:
            continue
        is_stuck = job.host_ids <= hosts or not hosts.isdisjoint(job.owner_ids)
        if is_stuck or not found.isdisjoint(job.after):
            found.add(job.index)
    return found
