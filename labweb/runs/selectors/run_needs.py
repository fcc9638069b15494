"""Which runs wait for a person, and which still need a resource."""

from __future__ import annotations

from collections.abc import Collection
from uuid import UUID

from django.db.models import Q, QuerySet

from labweb.accounts.selectors import User
from labweb.domain.runs.after_failure.recovery_choices import UNDONE
from labweb.domain.runs.exclusive_use.action_locks import conflicts, lock_set
from labweb.domain.runs.halts.halted_setpoints import LET_GO
from labweb.domain.runs.states.job_states import FINAL, JobState, RunState
from labweb.resources import selectors as resource_selectors
from labweb.runs.models import Job, Run
from labweb.runs.selectors.jobs_without_plans import with_runs
from labweb.runs.selectors.scheduling import asking

LIVE = [
    RunState.QUEUED.value,
    RunState.RUNNING.value,
    RunState.PAUSING.value,
    RunState.PAUSED.value,
    RunState.COMPLETING.value,
]

_MAY_GO = [*LIVE, RunState.AWAITING_APPROVAL.value]


def runs_that_wait(runs: QuerySet[Run]) -> QuerySet[Run]:
    """Return those of the runs that wait for a person, but for those with a job in doubt.

    A job in doubt is told by itself. A run that is still pausing waits as soon as a job of it has
    ended undone, or a halt or a loss has taken away what it had set, and nobody has answered: what
    acts elsewhere may go on for hours.
    """
    undone = Q(state__in=[one.value for one in UNDONE], passed_by="")
    taken = Q(state=JobState.COMPLETE.value) & ~Q(halted_by__in=["", LET_GO])
    open_jobs = Job.objects.filter(undone | taken)
    asking = Q(state=RunState.PAUSING.value, pk__in=open_jobs.values("run_id"))
    waiting = runs.filter(Q(state=RunState.PAUSED.value) | asking)
    return waiting.exclude(jobs__state=JobState.IN_DOUBT.value)


def jobs_that_ask(runs: QuerySet[Run]) -> list[Job]:
    """Return the jobs of runs that wait for nothing but a person who confirms them."""
    rows = Job.objects.filter(run__in=runs.filter(state__in=LIVE), state=JobState.QUEUED.value)
    rows = rows.filter(confirmed_at=None).exclude(asks="")
    found = list(with_runs(rows, "run__version__workflow").order_by("state_at", "index"))
    due = {run.pk: asking(run) for run in {job.run_id: job.run for job in found}.values()}
    return [job for job in found if job.pk in due[job.run_id]]


def runs_that_need(ids: Collection[UUID], *, besides: User) -> list[tuple[UUID, Run]]:
    """Return each of the resources with each run of others whose jobs will use it.

    A job needs what it locks, what stands in it, and what it stands in. Three queries.
    """
    final = [state.value for state in FINAL]
    jobs = Job.objects.filter(run__state__in=_MAY_GO).exclude(run__created_by=besides)
    jobs = with_runs(jobs.exclude(state__in=final), "run__created_by")
    needed: dict[UUID, set[UUID]] = {}
    runs: dict[UUID, Run] = {}
    for job in jobs:
        runs[job.run_id] = job.run
        needed.setdefault(job.run_id, set()).update(UUID(node) for node in job.locks)
    above = resource_selectors.ancestors(set(ids).union(*needed.values()))
    in_order = sorted(needed, key=lambda one: runs[one].number)
    taken = {run_id: lock_set(needed[run_id], above) for run_id in in_order}
    return [
        (node, runs[run_id])
        for run_id in in_order
        for node in sorted(ids)
        if conflicts(lock_set([node], above), taken[run_id])
    ]
