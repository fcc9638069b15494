"""What a person may do about a job that ended undone, and what follows from each choice."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from labweb.crutd.selectors import Transaction
from labweb.domain.crutd import operations
from labweb.domain.runs import recovery
from labweb.domain.runs.job import FINAL, JobState
from labweb.domain.runs.recovery import Choice, Ended, Later
from labweb.runs.models import Attempt, Job


def ended_job(job: Job) -> Ended:
    """Return a job that ended undone as the rules see it."""
    attempts = list(job.attempts.select_related("transaction").order_by("number"))
    last = attempts[-1].transaction if attempts else None
    failures = sum(bool(job.code) and one.transaction.code == job.code for one in attempts)
    return Ended(
        index=job.index,
        state=JobState(job.state),
        step_id=job.step_id,
        recovery=job.recovery,
        has_moved=last is not None and _has_moved(last),
        is_liquid=job.operation.get("op") == "transfer_liquid",
        failures=max(failures, 1),
    )


def _has_moved(row: Transaction) -> bool:
    return row.state == "committed"


def later_jobs(job: Job) -> list[Later]:
    """Return the jobs of the run that come after a job in its plan."""
    rows = Job.objects.filter(run_id=job.run_id, index__gt=job.index).order_by("index")
    return [
        Later(
            index=row.index,
            step_id=row.step_id,
            state=JobState(row.state),
            after=tuple(row.after),
            uses=frozenset(operations.touched_ids(operations.from_json(row.operation))),
        )
        for row in rows
    ]


def is_step_untouched(job: Job) -> bool:
    """Say whether no action of a job's step has moved anything."""
    moved = Attempt.objects.filter(
        job__run_id=job.run_id, job__step_id=job.step_id, transaction__state="committed"
    )
    return not moved.exists()


def recovery_choices(job: Job) -> tuple[Choice, ...]:
    """List what a person may do about a job, each with its consequence."""
    return recovery.choices_for(ended_job(job), is_step_untouched=is_step_untouched(job))


def recovery_of(job: Job) -> dict[str, Any] | None:
    """Return the recovery card of a job; None: it did not end undone, or it was decided."""
    if JobState(job.state) not in FINAL - {JobState.COMPLETE} or job.passed_by:
        return None
    ended, later = ended_job(job), later_jobs(job)
    targets = _targets(job)
    sentences = dict(Job.objects.filter(run_id=job.run_id).values_list("index", "sentence"))
    with_it = recovery.skipped_with(ended, later)
    relying = recovery.relying_on(targets, ended, later)
    return {
        "recovery": job.recovery,
        "tries": job.attempts.count(),
        "choices": [
            {"name": one.name, "why_not": one.why_not or None, "consequence": one.consequence}
            for one in recovery_choices(job)
        ],
        "skips": [sentences[index] for index in with_it],
        "relying": [sentences[index] for index in relying],
        "asked_ul": job.operation["amount_nl"] / 1000 if ended.is_liquid else None,
        "params": _params(job),
    }


def _targets(job: Job) -> frozenset[UUID]:
    operation = operations.from_json(job.operation)
    if isinstance(operation, operations.TransferLiquid):
        return frozenset({operation.target_id})
    return frozenset(operations.touched_ids(operation))


def _params(job: Job) -> dict[str, Any]:
    document = job.run.plan.get("document_now") or job.run.version.document
    steps = {step["id"]: step for step in document["steps"]}
    return dict(steps[job.step_id]["params"]) if job.step_id in steps else {}
