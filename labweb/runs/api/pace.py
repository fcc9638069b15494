"""Estimates by the clock on the wall: simulated instruments run at the pace of their host."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from labweb.common.clock import now
from labweb.runs.models import Job


def estimate_s(job: Job) -> float:
    """Return how long a job will take, real time; its device is loaded with its host."""
    return job.estimate_s / job.device.host.pace


def left_s(jobs: Iterable[Job]) -> float:
    """Return how long jobs that have not ended still take one after the other, real time."""
    at = now()
    return sum(max(estimate_s(job) - _spent_s(job, at.timestamp()), 0.0) for job in jobs)


def _spent_s(job: Job, at_s: float) -> float:
    return 0.0 if job.started_at is None else at_s - job.started_at.timestamp()


def on_the_wall(plan: Mapping[str, Any], jobs: Sequence[Job]) -> dict[str, Any]:
    """Return a rendered plan with the estimates of its steps and jobs in real time."""
    by_step = {job.step_id: job.device.host.pace for job in jobs}
    by_index = {job.index: job.device.host.pace for job in jobs}
    parts = [_at(one, by_index.get(one["index"], 1.0)) for one in plan["jobs"]]
    return {
        **plan,
        "steps": [_at(one, by_step.get(one["step_id"], 1.0)) for one in plan["steps"]],
        "jobs": parts,
        "estimate_s": sum(one["estimate_s"] for one in parts),
    }


def _at(row: Mapping[str, Any], pace: float) -> dict[str, Any]:
    return {**row, "estimate_s": row["estimate_s"] / pace}
