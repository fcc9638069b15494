"""Let the work of hosts that are away wait, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from uuid import UUID

from django.db.transaction import atomic

from labweb.domain.runs.dispatch.work_of_absent_host import AWAY, find_waiting
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import JobState, Mover
from labweb.enrollment import selectors as enrollment_selectors
from labweb.runs import selectors as run_selectors
from labweb.runs.selectors.open_jobs import jobs_to_move
from labweb.runs.services.execution.job_states import move_job, refresh_run


def isolate_hosts() -> int:
    """Suspend what waits for hosts that are away, and queue again what waits no more.

    Returns:
        How many jobs changed.

    Effect:
        None on matter. What was dispatched stays as it is: a silent host is not dead.
    """
    states = enrollment_selectors.session_states()
    is_any_away = not AWAY.isdisjoint(states.values())
    if not is_any_away and not run_selectors.has_suspended_jobs():
        return 0
    return sum(_isolate_run(run.id, states) for run in run_selectors.runs_with_waiting_jobs())


@atomic
def _isolate_run(run_id: UUID, states: Mapping[UUID, SessionState]) -> int:
    run_selectors.run_for_update(run_id)
    waiting = find_waiting(run_selectors.views(run_id), states)
    _move(waiting.suspend, JobState.SUSPENDED, "host.away", "it waits for a host that is away")
    _move(waiting.release, JobState.QUEUED, "", "")
    count = len(waiting.suspend) + len(waiting.release)
    if count:
        refresh_run(run_id)
    return count


def _move(ids: tuple[UUID, ...], state: JobState, code: str, message: str) -> None:
    for job in jobs_to_move(ids):
        if job.state in {JobState.QUEUED.value, JobState.SUSPENDED.value}:
            move_job(job, state, Mover.SERVER, code=code, message=message)
