"""Render jobs as the browser reads them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from datetime import datetime
from types import MappingProxyType
from uuid import UUID

import msgspec

from labweb.common.answers import KeyedRef
from labweb.domain.calibration.correction import Correction
from labweb.domain.runs.halts.halted_setpoints import is_halt_certain
from labweb.domain.runs.host_journal.surroundings import without_surroundings
from labweb.domain.runs.states.job_states import JobState
from labweb.runs import selectors
from labweb.runs.answers.jobs import JobAsks, JobRow, JobTransaction, passed_by
from labweb.runs.api.doubt_question import render_question
from labweb.runs.api.wall_clock import estimate_s
from labweb.runs.models import Attempt, Job


def render_asks(job: Job, asking: Collection[UUID]) -> JobAsks | None:
    """Say what a person confirms before a job is sent, and who has; None: nothing."""
    if not job.asks:
        return None
    by = job.confirmed_by
    return JobAsks(
        text=job.asks,
        states=selectors.to_state(job) if job.id in asking else None,
        is_due=job.id in asking,
        confirmed_by=None if by is None else by.printed_name,
        confirmed_at=job.confirmed_at,
    )


def render_job(
    job: Job,
    attempt: Attempt | None,
    names: Mapping[str, str],
    waiting: Mapping[UUID, tuple[str, datetime]] = MappingProxyType({}),
) -> JobRow:
    """Render one job with what is known of its outcome.

    Args:
        job: Which.
        attempt: Its newest try.
        names: Of resources, by id.
        waiting: By action, who has answered what became of it, and when; the host has not heard.
    """
    answered = None if attempt is None else waiting.get(attempt.id)
    return JobRow(
        id=job.id,
        index=job.index,
        step_id=job.step_id,
        sentence=job.sentence,
        device=KeyedRef(id=job.device_id, name=job.device.name, key=job.device.key),
        choices_count=len(job.choices),
        chosen=job.chosen or None,
        action=job.action,
        args=job.args,
        corrections=msgspec.convert(job.corrections, list[Correction]),
        operation=job.operation,
        state=JobState(job.state),
        state_at=job.state_at,
        started_at=job.started_at,
        ended_at=job.ended_at,
        uncertainty_s=job.uncertainty_s,
        is_bounded=job.is_bounded,
        estimate_s=estimate_s(job),
        verification=job.verification,
        code=job.code,
        message=job.message,
        evidence=without_surroundings(job.evidence),
        after=job.after,
        meets=job.meets,
        transaction=None
        if attempt is None
        else JobTransaction(id=attempt.transaction_id, state=attempt.transaction.state),
        passed_by=passed_by(job.passed_by),
        halted_by=job.halted_by or None,
        is_halt_certain=is_halt_certain(job.action),
        recovery_class=job.recovery,
        question=render_question(job, attempt, names, answered=answered),
    )
