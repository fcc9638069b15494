"""What a person confirms or states before a job is sent.

```text
confirm   the job is sent: a question is answered, a solid is weighed in
state     the job is passed over: all that is left is planned again with what was stated
```
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any
from uuid import UUID

from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.approvals import selectors as approval_selectors
from labweb.common.clock import now
from labweb.common.dispatcher_wakeup import wake_dispatcher
from labweb.crutd import services as crutd_services
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd import operations
from labweb.domain.crutd.operations import TransferMass
from labweb.domain.errors import DefinitionError, PreconditionError, StateError
from labweb.domain.runs.states.job_states import JobState
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.models import Job
from labweb.runs.services.execution.job_states import announce, refresh_run
from labweb.runs.services.planning.replan import change_step


@atomic
def confirm_job(job_id: UUID, *, actor: User, stated: Mapping[str, str] | None = None) -> Job:
    """Let a job that waits for a person be dispatched, or take its place with what is stated.

    Args:
        job_id: The job.
        actor: Who confirms or states.
        stated: Amount by the key of a lot, where the job asks for that: `{"brine": "all"}`. Of no
            lot: there is nothing to do, and the step is left out. What comes of solids is stated
            of each: a mass, `all` or `none`.

    Raises:
        DefinitionError: Lots are stated of a job that asks for none, or none of one that does.
        PreconditionError: What the job moves cannot be booked now, or is in use elsewhere.
        ProtocolError, PlanningError: What is left of the run cannot be planned, or not be
            proved, with what was stated; findings list each reason.
        StateError: The job asks nothing, its turn has not come or is over, its run is paused or
            given up, or somebody has confirmed it before; another step of the run is under way
            while the rest is to be planned again. Nothing was written.
        ForbiddenError: The actor may not run things on what the run uses.

    Effect:
        None yet. What the job moves by hand is written into the record when it is complete.
    """
    run = selectors.run_for_update(selectors.find_job(job_id).run_id)
    job = selectors.job_for_update(job_id)
    used = {UUID(node) for one in run.jobs.all() for node in one.locks}
    resource_selectors.require(actor, Permission.RUN, used)
    if not job.asks:
        raise StateError(f"{job.sentence!r} asks nobody", code="run.asks_nobody")
    if job.confirmed_by is not None:
        text = f"{job.confirmed_by.printed_name} has confirmed it already"
        raise StateError(text, code="run.confirmed_before")
    if run.pause_reasons or run.is_given_up or job.id not in selectors.asking(run):
        text = f"{job.sentence!r} waits for nobody now: run #{run.number} is {run.state}"
        raise StateError(text, code="run.not_asking")
    _check_stated(job, stated)
    detail: dict[str, Any] = {"run_id": str(run.id), "asked": job.asks}
    job.confirmed_by, job.confirmed_at = actor, now()
    if job.states:
        approved = approval_selectors.approved_of_run(run.id)
        is_left_out = not stated and job.states.get("leaves_out", True)
        params = None if is_left_out else {job.states["field"]: dict(stated or {})}
        detail |= change_step(
            run, job, params, actor=actor, state=JobState.QUEUED, approved=approved
        )
        job.refresh_from_db(fields=["state", "state_at", "passed_by", "code"])
    else:
        _check_bookable(job, actor)
    job.save(update_fields=["confirmed_by", "confirmed_at"])
    act = "job.state" if job.states else "job.confirm"
    account_services.write_audit(act, str(job.id), actor=actor, detail=detail)
    refresh_run(run.id)
    wake_dispatcher()
    on_commit(partial(announce, run.id, job.id))
    return selectors.find_job(job.id)


def _check_stated(job: Job, stated: Mapping[str, str] | None) -> None:
    told = selectors.to_state(job)
    # A vessel that holds no solid any more needs no statement of any.
    if told is not None and not told.leaves_out and told.lots and not stated:
        text = f"{job.asks} Say it of each solid: its mass, 'all' or 'none'"
        raise DefinitionError(text, code="run.nothing_stated")
    if told is not None and stated is None:
        text = f"{job.asks} Say it of each lot, with its amount or 'all'; of none: {{}}"
        raise DefinitionError(text, code="run.nothing_stated")
    if stated and not job.states:
        text = f"{job.sentence!r} asks for no amounts: confirm it without"
        raise DefinitionError(text, code="run.bad_amount")


def _check_bookable(job: Job, actor: User) -> None:
    """Refuse what the record would refuse, while nobody has confirmed it."""
    operation = operations.from_json(job.operation)
    found = crutd_services.check_operation(
        operation, lab=job.run.lab, actor_id=actor.pk, run_id=job.run_id
    )
    if found:
        raise PreconditionError(found[0].message, code=found[0].code, findings=found)


def tell_unbooked(job: Job, why: str) -> None:
    """Open a ticket for a solid that a person has weighed in and that no event books any more."""
    operation = operations.from_json(job.operation)
    if job.confirmed_at is None or not isinstance(operation, TransferMass):
        return
    by = "" if job.confirmed_by is None else f" by {job.confirmed_by.printed_name}"
    text = (
        f"{job.sentence}: it was confirmed{by} and is not on record, because {why}. Take stock of "
        "both vessels"
    )
    detail = {"job_id": str(job.id), "resource_id": str(operation.target_id)}
    crutd_services.open_ticket(job.run.lab, "run.not_booked", text, detail)
