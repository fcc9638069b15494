"""Render what a person is asked about a job in doubt, and what is known towards the answer."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from labweb.common.render import iso
from labweb.domain.runs.doubting import Measured, contradiction
from labweb.domain.runs.job import JobState
from labweb.domain.units import render_volume
from labweb.runs import selectors
from labweb.runs.models import Attempt, Job

_UNDONE = ("did_not", "partly", "discard")
"""Answers after which the job has ended undone, and something is decided about it."""


def render_question(
    job: Job,
    attempt: Attempt | None,
    names: Mapping[str, str],
    *,
    answered: tuple[str, datetime] | None,
) -> dict[str, Any] | None:
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
    return {
        "text": text,
        "attempt_id": None if attempt is None else str(attempt.id),
        "asked_ul": asked_nl / 1000 if asked_nl else None,
        "source": source,
        "target": target,
        "measured": None if measured is None else _measured(measured, asked_nl),
        "then": {answer: _choices(job, answer) for answer in _UNDONE},
        "answer_sent": answered is not None,
        "answered_by": answered and answered[0],
        "answered_at": answered and iso(answered[1]),
    }


def _measured(measured: Measured, asked_nl: int) -> dict[str, Any]:
    moved_nl = measured.moved_nl
    return {
        "text": measured.text,
        "before_ul": measured.before_ul,
        "after_ul": measured.after_ul,
        "moved_ul": None if moved_nl is None else moved_nl / 1000,
        "tolerance_ul": measured.tolerance_nl / 1000,
        "answer": measured.answer or None,
        "contradicts": [
            answer
            for answer in ("happened", "did_not")
            if contradiction(measured, answer, asked_nl=asked_nl, moved_nl=None) is not None
        ],
    }


def _choices(job: Job, answer: str) -> list[dict[str, Any]]:
    return [
        {"name": one.name, "why_not": one.why_not or None, "consequence": one.consequence}
        for one in selectors.choices_after(job, answer)
    ]
