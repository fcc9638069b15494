"""Estimates by the clock on the wall: simulated instruments run at the pace of their host."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeVar

from msgspec.structs import replace

from labweb.common.clock import now
from labweb.domain.runs.dispatch.job_duration import JobSpan, span_s
from labweb.domain.workflows.plan import PlannedStep
from labweb.runs.answers.plans import PlanJob, PlanView
from labweb.runs.models import Job

Timed = TypeVar("Timed", PlanJob, PlannedStep)


def estimate_s(job: Job) -> float:
    """Return how long a job will take, real time; its device is loaded with its host."""
    return job.estimate_s / job.device.host.pace


def whole_s(jobs: Iterable[Job]) -> float:
    """Return how long jobs take together from the first to the last, real time."""
    return span_s(_part(job, estimate_s(job)) for job in jobs)


def left_s(jobs: Iterable[Job]) -> float:
    """Return how long it is until the last of some jobs that have not ended does, real time."""
    at_s = now().timestamp()
    return span_s(_part(job, max(estimate_s(job) - _spent_s(job, at_s), 0.0)) for job in jobs)


def _part(job: Job, takes_s: float) -> JobSpan:
    return JobSpan(index=job.index, after=job.after, device=job.device_id, takes_s=takes_s)


def planned_s(jobs: Iterable[PlanJob]) -> float:
    """Return how long the jobs of a rendered plan take together."""
    return span_s(
        JobSpan(index=one.index, after=one.after, device=one.device.id, takes_s=one.estimate_s)
        for one in jobs
    )


def _spent_s(job: Job, at_s: float) -> float:
    return 0.0 if job.started_at is None else at_s - job.started_at.timestamp()


def on_the_wall(plan: PlanView, jobs: Sequence[Job]) -> PlanView:
    """Return a rendered plan with the estimates of its steps and jobs in real time."""
    by_step = {job.step_id: job.device.host.pace for job in jobs}
    by_index = {job.index: job.device.host.pace for job in jobs}
    parts = [_at(one, by_index.get(one.index, 1.0)) for one in plan.jobs]
    return replace(
        plan,
        steps=[_at(one, by_step.get(one.step_id, 1.0)) for one in plan.steps],
        jobs=parts,
        estimate_s=planned_s(parts),
    )


def _at(row: Timed, pace: float) -> Timed:
    return replace(row, estimate_s=row.estimate_s / pace)
