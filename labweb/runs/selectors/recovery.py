"""What a person may do about a job that ended undone, and what follows from each choice."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any
from uuid import UUID

import msgspec
from django.db.models import Q

from labweb.accounts.selectors import User
from labweb.crutd.selectors import Transaction
from labweb.domain.crutd import operations
from labweb.domain.runs.after_failure import doubt_by_readings
from labweb.domain.runs.after_failure import recovery_choices as recovery
from labweb.domain.runs.after_failure.plan_departures import Departure
from labweb.domain.runs.after_failure.recovery_choices import (
    UNDONE,
    Ended,
    LaterJob,
    Partner,
    PersonChoice,
    RunWaitCause,
)
from labweb.domain.runs.halts.halted_setpoints import LET_GO
from labweb.domain.runs.states.job_states import FINAL, JobState
from labweb.runs.answers.jobs import RecoveryCard
from labweb.runs.answers.jobs import recovery_choices as told_choices
from labweb.runs.models import Attempt, Job, Run


def ended_job(job: Job) -> Ended:
    """Return a job that ended undone as the rules see it."""
    return replace(_alone(job), partner=_partner_of(job))


def _alone(job: Job) -> Ended:
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
        is_mass=job.operation.get("op") == "transfer_mass",
        is_unknown=is_discarded(job) and job.operation.get("op") in _AMOUNTS,
        halted_by=job.halted_by,
        failures=max(failures, 1),
    )


def partner_job(job: Job) -> Job | None:
    """Return the job that has to begin at the same moment; None: it goes alone."""
    return None if job.meets is None else Job.objects.get(run_id=job.run_id, index=job.meets)


def _partner_of(job: Job) -> Partner | None:
    other = partner_job(job)
    if other is None:
        return None
    why_not = recovery.why_not_with(_alone(other), is_passed=bool(other.passed_by))
    return Partner(sentence=other.sentence, why_not=why_not)


_AMOUNTS = frozenset({"transfer_liquid", "transfer_mass"})
"""Operations that add to what is there; where a thing stands is known once it was looked for."""


def is_discarded(job: Job) -> bool:
    """Say whether a person gave up a try of a job in doubt: what it did is never known."""
    answer = (job.evidence.get("resolution") or {}).get("answer")
    return answer == "discard" or bool(job.evidence.get("is_discarded"))


_OF_AN_ANSWER = frozenset({"resolution", "then", "then_failed"})


def evidence_left(job: Job) -> dict[str, Any]:
    """Return what stays with a job that is tried again: no answer about a try before.

    That a try was given up in doubt stays true of the job.
    """
    kept = {name: value for name, value in job.evidence.items() if name not in _OF_AN_ANSWER}
    return kept | ({"is_discarded": True} if is_discarded(job) else {})


def _has_moved(row: Transaction) -> bool:
    return row.state == "committed"


def moved_nl(job: Job) -> int:
    """Return how much the device has moved for a job, over all its tries."""
    target = str(getattr(operations.from_json(job.operation), "target_id", ""))
    changes = (one.transaction.change for one in job.attempts.select_related("transaction"))
    postings = (posting for change in changes if change for posting in change["postings"])
    return sum(posting["amount_nl"] for posting in postings if posting["credit"] == target)


def accepted_departures(run: Run) -> list[Departure]:
    """Return how a run leaves what was proved as far as a person lets it go on so."""
    rows = [] if run.unproved is None else run.unproved["departures"]
    # Those that were kept without their place say too little: they are accepted anew.
    return [msgspec.convert(row, Departure) for row in rows if isinstance(row, dict)]


def is_unanswered(job: Job) -> bool:
    """Tell whether a person has to say first what a job did, or what becomes of it."""
    return _waits_for(job) is not None


def _waits_for(job: Job) -> RunWaitCause | None:
    state = JobState(job.state)
    return recovery.waits_for(state, is_passed=bool(job.passed_by), halted_by=job.halted_by)


def waits_of(run_ids: Iterable[UUID]) -> dict[UUID, RunWaitCause]:
    """Return what runs wait for, of those that wait for a person; one query."""
    waiting = Q(state=JobState.IN_DOUBT.value) | Q(state__in=[one.value for one in UNDONE])
    halted = ~Q(halted_by__in=["", LET_GO])
    rows = Job.objects.filter(waiting | halted, run_id__in=list(run_ids))
    found: dict[UUID, list[RunWaitCause | None]] = {}
    for job in rows.only("run_id", "state", "passed_by", "halted_by"):
        found.setdefault(job.run_id, []).append(_waits_for(job))
    waits = {run_id: recovery.run_waits_for(jobs) for run_id, jobs in found.items()}
    return {run_id: wait for run_id, wait in waits.items() if wait is not None}


def is_taken_away(job: Job) -> bool:
    """Tell whether a halt took away what a completed job had set, and nobody has answered."""
    return recovery.is_taken_away(JobState(job.state), job.halted_by)


def halted_jobs(run: Run) -> list[Job]:
    """Return the jobs of a run of which that is so, in the order of the plan."""
    rows = run.jobs.exclude(halted_by__in=["", LET_GO]).select_related("device").order_by("index")
    return [job for job in rows if is_taken_away(job)]


def has_paused(reasons: Iterable[Mapping[str, Any]], user: User) -> bool:
    """Tell whether a person has paused a run by themselves, by its reasons."""
    mine = (one for one in reasons if one.get("by_id") == str(user.pk))
    return any(one["kind"] == "user" for one in mine)


def later_jobs(job: Job) -> list[LaterJob]:
    """Return the jobs of the run that come after a job in its plan, or go with it."""
    behind = Q(index__gt=job.index) | Q(meets=job.index)
    rows = Job.objects.filter(behind, run_id=job.run_id).order_by("index")
    return [
        LaterJob(
            index=row.index,
            step_id=row.step_id,
            state=JobState(row.state),
            after=tuple(row.after),
            uses=frozenset(operations.touched_ids(operations.from_json(row.operation))),
            meets=row.meets,
        )
        for row in rows
    ]


def is_step_untouched(job: Job) -> bool:
    """Say whether no action of a job's step has moved anything, or may have."""
    tried = Attempt.objects.filter(job__run_id=job.run_id, job__step_id=job.step_id)
    moved = Q(transaction__state="committed") | Q(job__evidence__resolution__answer="discard")
    return not tried.filter(moved | Q(job__evidence__is_discarded=True)).exists()


def recovery_choices(job: Job) -> tuple[PersonChoice, ...]:
    """List what a person may do about a job, each with its consequence."""
    return recovery.choices_for(ended_job(job), is_step_untouched=is_step_untouched(job))


def choices_after(job: Job, answer: str) -> tuple[PersonChoice, ...]:
    """List what may follow an answer that leaves a job in doubt undone."""
    is_amount = job.operation.get("op") in _AMOUNTS
    ended = replace(
        ended_job(job),
        state=JobState.ABORTED,
        has_moved=answer == "partly",
        is_unknown=is_amount and (answer == "discard" or is_discarded(job)),
    )
    return doubt_by_readings.choices_after(ended, is_step_untouched=is_step_untouched(job))


def recovery_of(job: Job) -> RecoveryCard | None:
    """Return the recovery card of a job; None: it stands as done, or it was decided."""
    is_undone = JobState(job.state) in FINAL - {JobState.COMPLETE} and not job.passed_by
    if not is_undone and not is_taken_away(job):
        return None
    ended, later = ended_job(job), later_jobs(job)
    targets = _targets(job)
    sentences = dict(Job.objects.filter(run_id=job.run_id).values_list("index", "sentence"))
    with_it = recovery.skipped_with(ended, later) if is_undone else []
    relying = recovery.relying_on(targets, ended, later)
    return RecoveryCard(
        recovery=job.recovery,
        tries=job.attempts.count(),
        choices=told_choices(recovery_choices(job)),
        skips=[sentences[index] for index in with_it],
        relying=[sentences[index] for index in relying],
        asked_ul=job.operation["amount_nl"] / 1000 if ended.is_liquid else None,
        moved_ul=moved_nl(job) / 1000 if ended.is_liquid else None,
        params=_params(job),
    )


def _targets(job: Job) -> frozenset[UUID]:
    operation = operations.from_json(job.operation)
    if isinstance(operation, operations.TransferLiquid):
        return frozenset({operation.target_id})
    return frozenset(operations.touched_ids(operation))


def _params(job: Job) -> dict[str, Any]:
    document = job.run.plan.get("document_now") or job.run.version.document
    steps = {step["id"]: step for step in document["steps"]}
    return dict(steps[job.step_id]["params"]) if job.step_id in steps else {}
