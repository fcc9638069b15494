"""A device is read after a person has answered for it: where both differ a person is asked."""

from __future__ import annotations

from functools import partial

from django.db.transaction import atomic, on_commit

from labweb.crutd import services as crutd_services
from labweb.crutd.selectors.doubt_resolutions import Resolved, resolved_of
from labweb.domain.runs.after_failure.doubt_by_readings import (
    LateAnswer,
    PlungerMeasured,
    claimed_nl,
    contradiction,
    later_words,
)
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.models import Attempt, Job
from labweb.runs.services.execution.job_states import announce


def reread_answers() -> int:
    """Compare answers that were given before their device was read with what it reads since.

    Returns:
        How many are contradicted.

    Effect:
        None on matter and on the record: a ticket asks a person to look.
    """
    return sum(_reread(attempt) for attempt in selectors.unread_answers())


@atomic
def _reread(attempt: Attempt) -> bool:
    """Compare one answer, once; it waits until its host has settled it and its device is read."""
    selectors.run_for_update(attempt.job.run_id)
    job = selectors.job_for_update(attempt.job_id)
    unread = job.evidence.get(selectors.UNREAD, [])
    about = attempt.transaction_id
    resolved = resolved_of([about]).get(about)
    if str(attempt.pk) not in unread or resolved is None:
        return False
    measured = selectors.measured_of(job, attempt)
    if measured is None or measured.after_ul is None:
        return False
    left = [one for one in unread if one != str(attempt.pk)]
    kept = {name: value for name, value in job.evidence.items() if name != selectors.UNREAD}
    job.evidence = {**kept, selectors.UNREAD: left} if left else kept
    is_contradicted = _ask(job, attempt, resolved, measured)
    job.save(update_fields=["evidence"])
    on_commit(partial(announce, job.run_id, job.pk))
    return is_contradicted


def _ask(job: Job, attempt: Attempt, resolved: Resolved, measured: PlungerMeasured) -> bool:
    """Open a ticket where the reading contradicts the answer; the job leads to it."""
    told, asked_nl = resolved.resolution, selectors.asked_nl(job)
    answer, moved_nl = str(told.get("answer")), told.get("moved_nl")
    claimed = claimed_nl(answer, asked_nl=asked_nl, moved_nl=moved_nl)
    found = contradiction(measured, answer, asked_nl=asked_nl, moved_nl=moved_nl)
    if found is None or claimed is None or measured.moved_nl is None:
        return False
    names = resource_selectors.names_in([job.operation["source_id"], job.operation["target_id"]])
    text = later_words(
        LateAnswer(
            by=resolved.by or "a person",
            device=job.device.name,
            source=names[job.operation["source_id"]],
            target=names[job.operation["target_id"]],
            claimed_nl=claimed,
            measured_nl=measured.moved_nl,
            reading=measured.text,
        )
    )
    detail = {
        "transaction_id": str(attempt.transaction_id),
        "run_id": str(job.run_id),
    }
    ticket = crutd_services.open_ticket(job.run.lab, "run.answer_contradicted", text, detail)
    contradicted = [*job.evidence.get(selectors.CONTRADICTED_BY, ()), str(ticket.pk)]
    job.evidence = {**job.evidence, selectors.CONTRADICTED_BY: contradicted}
    return True
