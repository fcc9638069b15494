"""What a person decides about a job that ended undone: again, otherwise, by hand, or not at all."""

from __future__ import annotations

from functools import partial
from typing import Any
from uuid import UUID

from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common.clock import now
from labweb.crutd import services as crutd_services
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd import operations
from labweb.domain.crutd.lots_of_partial_transfer import part_of, rest_of
from labweb.domain.crutd.operations import TransferLiquid, TransferMass, TransferResource
from labweb.domain.errors import DefinitionError, StateError
from labweb.domain.runs.after_failure import recovery_choices
from labweb.domain.runs.halts.halted_setpoints import LET_GO
from labweb.domain.runs.states.job_states import UNSTARTED, JobState, Mover, RunState
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.models import Job, Run
from labweb.runs.services.execution.custody import begin_transfer
from labweb.runs.services.execution.job_states import announce, move_job, refresh_run
from labweb.runs.services.planning.proof_departures import departure_of
from labweb.runs.services.planning.replan import change_step

CHOICES = ("retry", "skip", "done_by_hand", "change")


@atomic
def recover_job(
    job_id: UUID,
    *,
    actor: User,
    choice: str,
    note: str,
    moved_nl: int | None = None,
    params: dict[str, Any] | None = None,
) -> Job:
    """Carry out what a person chose about a job that ended undone.

    The run stays paused until a person resumes it, so that several choices can be made; one
    of which nothing is left ends. Of a recipe each choice is compared with what was proved, and
    what leaves it is kept with the choice.

    Raises:
        DefinitionError: No such choice, no note, an amount that cannot be, or one or values
            beside a choice that has none.
        StateError: The choice is not offered for this job; the message says why.
        ForbiddenError: The actor may not run things on what the job uses.
        PreconditionError: What was done by hand breaks a rule of the record.

    Effect:
        `done_by_hand` writes the named amount into the record. The others change no record.
    """
    run = selectors.run_for_update(selectors.find_job(job_id).run_id)
    job = selectors.job_for_update(job_id)
    resource_selectors.require(actor, Permission.RUN, [UUID(node) for node in job.locks])
    _check(run, job, choice, note)
    _check_beside(choice, moved_nl, params)
    detail: dict[str, Any] = {"choice": choice, "job_id": str(job.id), "note": note}
    if choice == "retry":
        _again(run, job)
    elif choice == "skip" and job.state == JobState.COMPLETE.value:
        detail["halted_by"], job.halted_by = job.halted_by, LET_GO
        job.save(update_fields=["halted_by"])
    elif choice == "skip":
        detail["with"] = _skip(run, job)
    elif choice == "done_by_hand":
        detail["moved_nl"] = _by_hand(job, actor, moved_nl, note)
    else:
        detail |= change_step(run, job, params or {}, actor=actor)
    detail |= departure_of(run, job, detail)
    _keep(run, actor, detail)
    account_services.write_audit(
        "job.recover", str(job.id), actor=actor, reason=note, detail=detail
    )
    refresh_run(run.id)
    on_commit(partial(announce, run.id, job.id))
    return selectors.find_job(job.id)


def _check(run: Run, job: Job, choice: str, note: str) -> None:
    if choice not in CHOICES:
        known = ", ".join(CHOICES)
        raise DefinitionError(f"choose one of {known}", code="run.bad_choice")
    if not note.strip():
        raise DefinitionError("say why: the note is empty", code="run.note_missing")
    if run.state in {RunState.COMPLETE.value, RunState.ABORTED.value} or run.is_given_up:
        raise StateError(f"run #{run.number} is {run.state}", code="run.ended")
    if job.passed_by:
        raise StateError("this was decided before", code="run.recovered")
    found = next(one for one in selectors.recovery_choices(job) if one.name == choice)
    if found.why_not:
        raise StateError(f"{choice}: {found.why_not}", code="run.not_offered")


def _again(run: Run, job: Job) -> None:
    """Queue a job anew. What comes after it in the plan waits for it, though it was done before."""
    if job.state == JobState.COMPLETE.value:
        for later in run.jobs.filter(index__gt=job.index).exclude(after__contains=[job.index]):
            if later.state != JobState.COMPLETE.value:
                later.after = sorted([*later.after, job.index])
                later.save(update_fields=["after"])
    _queue(job)
    other = selectors.partner_job(job)
    if other is not None and JobState(other.state) in recovery_choices.UNDONE:
        _queue(other)


def _queue(job: Job) -> None:
    """Queue a job again; what a person confirmed before it failed, somebody confirms once more."""
    left = selectors.evidence_left(job)
    job.confirmed_by, job.confirmed_at = None, None
    job.save(update_fields=["confirmed_by", "confirmed_at"])
    move_job(job, JobState.QUEUED, Mover.PERSON, code="", message="", passed_by="", evidence=left)


def _check_beside(choice: str, moved_nl: int | None, params: dict[str, Any] | None) -> None:
    if moved_nl is not None and choice != "done_by_hand":
        message = f"an amount goes with 'done_by_hand' alone, not with {choice!r}"
        raise DefinitionError(message, code="run.bad_amount")
    if params is not None and choice != "change":
        message = f"values go with 'change' alone, not with {choice!r}"
        raise DefinitionError(message, code="run.bad_choice")


def _keep(run: Run, actor: User, detail: dict[str, Any]) -> None:
    by = {"by": actor.printed_name, "by_id": str(actor.pk), "at": now().isoformat()}
    run.recoveries = [*run.recoveries, {**detail, **by}]
    kinds = {entry["kind"] for entry in run.pause_reasons}
    if "recovery" not in kinds:
        entry = {"kind": "recovery", "by": by["by"], "at": by["at"]}
        run.pause_reasons = [*run.pause_reasons, entry]
    run.save(update_fields=["recoveries", "pause_reasons"])


def _skip(run: Run, job: Job) -> list[int]:
    """Pass a job over, and what is left of its step behind it."""
    job.passed_by = "skip"
    job.save(update_fields=["passed_by"])
    indices = recovery_choices.skipped_with(selectors.ended_job(job), selectors.later_jobs(job))
    for other in Job.objects.filter(run=run, index__in=indices).order_by("index"):
        if other.state in {JobState.QUEUED.value, JobState.HELD.value, JobState.SUSPENDED.value}:
            move_job(other, JobState.STOPPED, Mover.SERVER, code="run.skipped", passed_by="skip")
        else:
            raise StateError(f"{other.sentence!r} is under way", code="run.step_under_way")
    return indices


def _by_hand(job: Job, actor: User, moved_nl: int | None, note: str) -> int | None:
    """Write down what a person did beside what the device moved, and pass the job over."""
    operation = operations.from_json(job.operation)
    if isinstance(operation, TransferLiquid):
        _pour(job, operation, actor, moved_nl, note)
    elif isinstance(operation, TransferResource) and moved_nl is None:
        told = f"by hand for {job.sentence}: {note}"
        if begin_transfer(operation, actor=actor, note=told, run_id=job.run_id) is None:
            crutd_services.carry_out(
                operation, lab=job.run.lab, actor_id=actor.pk, note=told, run_id=job.run_id
            )
    elif moved_nl is not None:
        raise DefinitionError("nothing is poured by this job", code="run.bad_amount")
    elif isinstance(operation, TransferMass):
        told = f"by hand for {job.sentence}: {note}"
        crutd_services.carry_out(
            operation, lab=job.run.lab, actor_id=actor.pk, note=told, run_id=job.run_id
        )
    job.passed_by = "hand"
    job.save(update_fields=["passed_by"])
    other = selectors.partner_job(job)
    if other is not None and JobState(other.state) in UNSTARTED:
        move_job(other, JobState.STOPPED, Mover.SERVER, code="run.skipped", passed_by="hand")
    return moved_nl


def _pour(
    job: Job, operation: TransferLiquid, actor: User, moved_nl: int | None, note: str
) -> None:
    """Write down the liquid that a person moved; none only where the device has moved some."""
    before_nl = selectors.moved_nl(job)
    if moved_nl is None or moved_nl < 0 or (moved_nl == 0 and before_nl <= 0):
        raise DefinitionError("say how much you moved", code="run.bad_amount")
    if moved_nl:
        done = part_of(rest_of(operation, before_nl), moved_nl)
        told = f"by hand for {job.sentence}: {note}"
        crutd_services.carry_out(
            done, lab=job.run.lab, actor_id=actor.pk, note=told, run_id=job.run_id
        )
