"""A person says what an action in doubt did, and perhaps what follows then."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any
from uuid import UUID

from django.db.transaction import atomic, on_commit

from labweb.accounts import selectors as account_selectors
from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common.clock import now
from labweb.common.render import iso
from labweb.crutd import services as crutd_services
from labweb.crutd.services import Settlement
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd.settlement import OutcomeKind
from labweb.domain.errors import DefinitionError, LabError, PreconditionError, StateError
from labweb.domain.runs.after_failure.doubt_by_readings import (
    AFTERWARDS,
    against_the_record,
    contradiction,
    is_worth_reading,
)
from labweb.domain.runs.host_journal.action_states import ANSWERS, ActionState, resolve
from labweb.domain.runs.host_link.host_session import is_given_up
from labweb.domain.runs.states.job_states import JobState, Mover
from labweb.enrollment import services as enrollment_services
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.models import Attempt, Job, Outbox
from labweb.runs.services.execution import dispatch
from labweb.runs.services.execution.job_states import announce, move_job, refresh_run
from labweb.runs.services.fault_recovery.undone_jobs import recover_job
from labweb.runs.services.stopping.abort import abort_run
from labweb.runs.services.stopping.device_halts import undo_settled

ABORT = "abort"
THEN = "then"
"""Where the evidence of a job keeps what is to follow its answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Beside:
    """What a person says beside their answer about an action in doubt."""

    attempt_id: UUID | None = None
    """Which doubt it answers: the try of the job. None: the job has been in doubt but once."""

    despite_reading: bool = False
    """The person knows that the device reads otherwise."""

    then: str = ""
    """What follows: `retry`, `skip`, `done_by_hand` or `abort`; empty: that is decided later."""

    then_moved_nl: int | None = None
    """What was moved by hand, with `done_by_hand`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Told(Beside):
    answer: str
    note: str
    moved_nl: int | None


@atomic
def resolve_job(
    job_id: UUID,
    *,
    actor: User,
    answer: str,
    moved_nl: int | None,
    note: str,
    beside: Beside | None = None,
) -> Job:
    """Send a person's answer about a job in doubt to its host, which settles it.

    Raises:
        DefinitionError: The answer is none of the four, an amount is missing, more than was
            asked for or beside another answer than `partly`, the note is empty, or what is to
            follow cannot follow such an answer.
        StateError: The job is not in doubt, another of its doubts is meant, or it was answered
            before.
        PreconditionError: The device reads otherwise, and the person does not say that the
            answer stands despite that.

    Effect:
        The host stays the single writer of physical facts: the record changes when its
        RESOLVED event comes back, and what is to follow is done then.
    """
    told = _Told(answer=answer, moved_nl=moved_nl, note=note, **asdict(beside or Beside()))
    selectors.run_for_update(selectors.find_job(job_id).run_id)
    job = selectors.job_for_update(job_id)
    resource_selectors.require(actor, Permission.RESOLVE, [UUID(node) for node in job.locks])
    _check_answer(job, told)
    if job.state != JobState.IN_DOUBT.value:
        raise StateError(f"this job is {job.state}, not in doubt", code="run.not_in_doubt")
    attempt = selectors.last_attempt(job)
    if attempt is None:
        raise StateError("this job was never dispatched", code="run.not_in_doubt")
    _check_doubt(job, attempt, told)
    _check_then(job, actor, told)
    reading = _check_reading(job, attempt, told)
    record = enrollment_services.record_of(attempt.host)
    if is_given_up(record, attempt.dseq):
        _keep_then(job, actor, told)
        _audit(job, attempt, actor, told, reading, is_settled_here=True)
        return _settle_here(job, attempt, actor, told, reading)
    if record.quarantine:
        raise StateError(
            f"{attempt.host.name} is quarantined: readmit it first", code="run.host_quarantined"
        )
    _send(attempt, actor, told, reading)
    _keep_then(job, actor, told)
    _audit(job, attempt, actor, told, reading)
    on_commit(partial(announce, job.run_id, job.id))
    return job


def _send(attempt: Attempt, actor: User, told: _Told, reading: str) -> None:
    waiting = Outbox.objects.filter(action_id=attempt.id, kind="resolve", settled_at__isnull=True)
    if waiting.exists():
        raise StateError("an answer is on its way to the host", code="run.answered")
    dispatch.send_resolution(
        attempt,
        answer=told.answer,
        moved_nl=told.moved_nl,
        note=told.note,
        issued_by=str(actor.pk),
        despite_reading=reading,
    )


def _audit(
    job: Job, attempt: Attempt, actor: User, told: _Told, reading: str, **more: bool
) -> None:
    detail = {
        "answer": told.answer,
        "moved_nl": told.moved_nl,
        "attempt_id": str(attempt.id),
        "despite_reading": reading,
        "then": told.then,
        **more,
    }
    account_services.write_audit(
        "job.resolve",
        str(job.id),
        actor=actor,
        reason=told.note,
        detail=detail,
        meaning="says what became of an action in doubt",
    )


def _check_answer(job: Job, told: _Told) -> None:
    answer, moved_nl = told.answer, told.moved_nl
    if not told.note.strip():
        raise DefinitionError("say what you saw: the note is empty", code="run.note_missing")
    if resolve(answer, moved_nl=moved_nl) is None:
        known = ", ".join(ANSWERS)
        raise DefinitionError(
            f"answer with one of {known}; 'partly' needs an amount above zero",
            code="run.bad_answer",
        )
    if answer != "partly" and moved_nl is not None:
        message = f"an amount goes with 'partly' alone, not with {answer!r}"
        raise DefinitionError(message, code="run.bad_amount")
    if answer == "partly":
        asked = selectors.asked_nl(job)
        if moved_nl is None or moved_nl >= asked:
            raise DefinitionError(
                f"'partly' must be less than the {asked / 1_000_000:g} mL that were asked for",
                code="run.bad_amount",
            )


def _check_doubt(job: Job, attempt: Attempt, told: _Told) -> None:
    """Refuse an answer to another doubt than the present one; a name is needed where two were."""
    if told.attempt_id == attempt.id:
        return
    if told.attempt_id is None and not selectors.has_older_doubt(attempt):
        return
    message = (
        "the answer is about an earlier try of this job, and another one is in doubt now"
        if told.attempt_id is not None
        else "this job was in doubt before: name the try that the answer is about"
    )
    raise StateError(
        f"{message}: look at what is asked now",
        code="run.other_doubt",
        context={"attempt_id": str(attempt.id), "doubt_at": iso(job.state_at)},
    )


def _check_reading(job: Job, attempt: Attempt, told: _Told) -> str:
    """Return what the device reads against the answer, where the person answers despite it.

    Where it has not been read yet the job keeps that, to be looked at again with the reading.

    Raises:
        PreconditionError: It reads otherwise, and nobody has said that they know.
    """
    measured = selectors.measured_of(job, attempt)
    if measured is None:
        return ""
    asked_nl = selectors.asked_nl(job)
    if is_worth_reading(measured, told.answer, asked_nl=asked_nl, moved_nl=told.moved_nl):
        unread = [*job.evidence.get(selectors.UNREAD, ()), str(attempt.id)]
        job.evidence = {**job.evidence, selectors.UNREAD: unread}
        job.save(update_fields=["evidence"])
        return ""
    found = contradiction(measured, told.answer, asked_nl=asked_nl, moved_nl=told.moved_nl)
    if found is None:
        return ""
    if not told.despite_reading:
        raise PreconditionError(
            found.message, code=found.code, findings=[found], context=dict(found.context)
        )
    return measured.text


def _check_then(job: Job, actor: User, told: _Told) -> None:
    """Refuse what could not follow the answer, before that is sent."""
    if told.then_moved_nl is not None and told.then != "done_by_hand":
        message = f"an amount by hand goes with 'done_by_hand' alone, not with {told.then!r}"
        raise DefinitionError(message, code="run.bad_amount")
    if not told.then:
        return
    resource_selectors.require(actor, Permission.RUN, [UUID(node) for node in job.locks])
    if told.then == ABORT:
        return
    if told.answer == "happened" or told.then not in AFTERWARDS:
        known = ", ".join((*AFTERWARDS, ABORT))
        message = (
            "an action that happened needs nothing more: leave out what follows"
            if told.answer == "happened"
            else f"what follows is one of {known}"
        )
        raise DefinitionError(message, code="run.bad_choice")
    choices = {one.name: one for one in selectors.choices_after(job, told.answer)}
    why_not = choices[told.then].why_not
    if why_not:
        raise StateError(f"{told.then}: {why_not}", code="run.not_offered")
    needs_amount = told.then == "done_by_hand" and selectors.asked_nl(job)
    if needs_amount and told.then_moved_nl is None:
        raise DefinitionError("say how much you moved by hand", code="run.bad_amount")


def _keep_then(job: Job, actor: User, told: _Told) -> None:
    if not told.then:
        return
    kept = {
        "choice": told.then,
        "moved_nl": told.then_moved_nl,
        "note": told.note,
        "by": actor.printed_name,
        "by_id": str(actor.pk),
    }
    job.evidence = {**job.evidence, THEN: kept}
    job.save(update_fields=["evidence"])


def _settle_here(job: Job, attempt: Attempt, actor: User, told: _Told, reading: str) -> Job:
    """Settle on the server what the host can never tell: its journal was set aside."""
    found = resolve(told.answer, moved_nl=told.moved_nl)
    if found is None:
        raise DefinitionError(f"{told.answer!r} answers nothing", code="run.bad_answer")
    state, outcome = found
    answer = {
        "answer": told.answer,
        "note": told.note,
        "by_id": str(actor.pk),
        "moved_nl": told.moved_nl,
        "despite_reading": reading,
    }
    settlement = Settlement(
        outcome=outcome, verification="assumed", actor_id=actor.pk, resolution=answer
    )
    if outcome.kind is OutcomeKind.UNKNOWN:
        kept = replace(settlement, keep_quarantined=True)
        crutd_services.discard(attempt.transaction_id, kept)
    else:
        try:
            crutd_services.settle(attempt.transaction_id, settlement)
        except StateError as error:
            raise StateError(against_the_record(error), code=error.code) from error
    resolution = {
        **answer,
        "by": actor.printed_name,
        "doubt_at": iso(job.state_at),
        "at": iso(now()),
    }
    evidence = {**job.evidence, "resolution": resolution}
    is_done = state is ActionState.COMPLETE
    stands = {"halted_by": ""} if is_done else {}
    move_job(job, JobState(state.value), Mover.PERSON, evidence=evidence, **stands)
    if is_done:
        undo_settled(job, attempt)
    refresh_run(job.run_id)
    follow(job.pk)
    return selectors.find_job(job.pk)


def follow(job_id: UUID) -> None:
    """Do what a person wanted to follow their answer, once that has settled the job.

    What cannot be done any more is left undone and said on the job; the run then waits for a
    decision as ever.
    """
    job = selectors.find_job(job_id)
    wanted: Mapping[str, Any] | None = job.evidence.get(THEN)
    if wanted is None:
        return
    evidence = {name: value for name, value in job.evidence.items() if name != THEN}
    Job.objects.filter(pk=job.pk).update(evidence=evidence)
    try:
        with atomic():
            _follow(job, wanted)
    except LabError as error:
        failed = {**wanted, "why_not": error.message}
        Job.objects.filter(pk=job.pk).update(evidence={**evidence, "then_failed": failed})
    on_commit(partial(announce, job.run_id, job.pk))


def _follow(job: Job, wanted: Mapping[str, Any]) -> None:
    actor = account_selectors.user_by_id(UUID(wanted["by_id"]))
    if actor is None:
        raise StateError("who answered is no user any more", code="run.not_offered")
    if wanted["choice"] == ABORT:
        abort_run(job.run_id, actor=actor, reason=wanted["note"])
        return
    recover_job(
        job.pk,
        actor=actor,
        choice=wanted["choice"],
        note=wanted["note"],
        moved_nl=wanted["moved_nl"],
    )
