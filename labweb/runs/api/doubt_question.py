"""Render what a person is asked about a job in doubt, and what is known towards the answer."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime

from labweb.domain.runs.after_failure.doubt_by_readings import PlungerMeasured, contradiction
from labweb.domain.runs.states.job_states import JobState
from labweb.domain.units import render_volume
from labweb.runs import selectors
from labweb.runs.answers.jobs import (
    JobQuestion,
    MeasuredAmount,
    PlungerAnswer,
    plunger_answer,
    recovery_choices,
)
from labweb.runs.models import Attempt, Job

_UNDONE = ("did_not", "partly", "discard")
"""Answers after which the job has ended undone, and something is decided about it."""

_WITHOUT_AMOUNT: tuple[PlungerAnswer, ...] = ("happened", "did_not")


def render_question(
    job: Job,
    attempt: Attempt | None,
    names: Mapping[str, str],
    *,
    answered: tuple[str, datetime] | None,
) -> JobQuestion | None:
    """Render the question of a job; None: it is not in doubt.

    Args:
        job: Which.
        attempt: Its newest try, which is the one in doubt.
        names: Of resources, by id.
        answered: Who has answered, and when; the host has not heard.
    """
    if job.state != JobState.IN_DOUBT.value:
        return None
    operation = job.operation
    source = target = ""
    text, asked_nl = f"Did this happen: {job.sentence}?", selectors.asked_nl(job)
    if asked_nl:
        source = names.get(operation["source_id"], "?")
        target = names.get(operation["target_id"], "?")
        text = f"Was {render_volume(asked_nl)} moved from {source} to {target}?"
    measured = None if attempt is None else selectors.measured_of(job, attempt)
    return JobQuestion(
        text=text,
        attempt_id=None if attempt is None else attempt.id,
        asked_ul=asked_nl / 1000 if asked_nl else None,
        source=source,
        target=target,
        measured=None if measured is None else _measured(measured, asked_nl),
        then={answer: recovery_choices(selectors.choices_after(job, answer)) for answer in _UNDONE},
        answer_sent=answered is not None,
        answered_by=None if answered is None else answered[0],
        answered_at=None if answered is None else answered[1],
    )


def _measured(measured: PlungerMeasured, asked_nl: int) -> MeasuredAmount:
    moved_nl = measured.moved_nl
    return MeasuredAmount(
        text=measured.text,
        before_ul=measured.before_ul,
        after_ul=measured.after_ul,
        moved_ul=None if moved_nl is None else moved_nl / 1000,
        tolerance_ul=measured.tolerance_nl / 1000,
        answer=plunger_answer(measured.answer),
        contradicts=[
            answer
            for answer in _WITHOUT_AMOUNT
            if contradiction(measured, answer, asked_nl=asked_nl, moved_nl=None) is not None
        ],
    )
