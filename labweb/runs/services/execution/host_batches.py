"""Send all that a host does of a run at once, for hosts that go on with the server away."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from uuid import UUID

import msgspec
from django.db.transaction import atomic

from labweb.common.clock import new_id, now
from labweb.common.database.prepared_queries import together
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd import services as crutd_services
from labweb.crutd.selectors import Transaction
from labweb.crutd.selectors.placement import with_place
from labweb.domain.crutd import operations
from labweb.domain.errors import LockedError, PreconditionError
from labweb.domain.messages.commands import BatchPart, Do, ResourceView
from labweb.domain.runs.dispatch.command_outbox import BatchDraft
from labweb.domain.runs.states.job_states import JobState, Mover
from labweb.domain.workflows.plan import Execution
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.models import Attempt, Job, Outbox, Run
from labweb.runs.services.driver_switches import switch_before
from labweb.runs.services.execution import dispatch, run_holds
from labweb.runs.services.execution.job_states import (
    check_not_halting,
    hold_job,
    move_job,
    note_sent,
)

logger = logging.getLogger(__name__)

_WAITING = [JobState.DISPATCHED.value, JobState.ACCEPTED.value]
"""Where a job stands that a host has, or is about to get, and has not begun."""

_WAIT_S = 3600.0
"""Beside what comes before it, for how long a member may wait."""


def dispatch_batch(run_id: UUID, job_ids: Sequence[UUID], execution: Execution) -> int:
    """Lock everything that the jobs need and write one command for them all.

    Returns:
        How many were dispatched: all, or none. A precondition of a first job that fails now
        holds that job, which pauses its run.
    """
    try:
        with atomic():
            return _dispatch(run_id, job_ids, execution)
    except LockedError as error:
        logger.debug("a batch of run %s waits: %s", run_id, error.message)
        run_holds.note_waiting(run_id, error)
        return 0
    except PreconditionError as error:
        hold_job(job_ids[0], error)
        return 0


def _dispatch(run_id: UUID, job_ids: Sequence[UUID], execution: Execution) -> int:
    host_id = Job.objects.values_list("device__host_id", flat=True).get(pk=job_ids[0])
    host = enrollment_selectors.host_for_update(host_id)
    run = selectors.run_for_update(run_id)
    jobs = [selectors.job_for_update(job_id) for job_id in job_ids]
    if run.pause_reasons or any(job.state != JobState.QUEUED.value for job in jobs):
        return 0
    granted = run_holds.ask(run, jobs)
    switch_before(host, jobs)
    halting = selectors.HALTING_AT.rows(host=host.pk)
    check_not_halting(jobs, {device_id for (device_id,) in halting})
    dispatch.check_calibrations(jobs)
    batch_id = new_id()
    indices = {job.index for job in jobs}
    members = [
        crutd_services.Member(
            operation=operations.from_json(job.operation),
            targets=[UUID(node) for node in job.locks],
            job_id=job.id,
            is_first=indices.isdisjoint(job.after),
        )
        for job in jobs
    ]
    try:
        transactions = crutd_services.lock_batch(
            members,
            batch_id=batch_id,
            lab=run.lab,
            asker=crutd_services.Asker(actor_id=run.created_by_id, run_id=run.pk),
            granted=granted.modes,
        )
    except LockedError as error:
        raise granted.in_line(error) from error
    together(*granted.writing)
    attempts = [
        _attempt(host, job, transaction, batch_id)
        for job, transaction in zip(jobs, transactions, strict=True)
    ]
    host.save(update_fields=["last_dseq"])
    draft = BatchDraft(
        batch_id=batch_id,
        members=_commands(jobs, attempts, execution),
        resources=_views(jobs),
        issued_by=str(run.created_by_id),
    )
    body = msgspec.to_builtins(draft)
    Outbox.objects.create(host=host, action_id=batch_id, kind="batch", body=body, at=now())
    for job in jobs:
        move_job(job, JobState.DISPATCHED, Mover.SCHEDULER)
    note_sent(run)
    return len(jobs)


def _attempt(host: EdgeHost, job: Job, transaction: Transaction, batch_id: UUID) -> Attempt:
    host.last_dseq += 1
    return Attempt.objects.create(
        id=new_id(),
        job=job,
        number=selectors.next_number(job),
        host=host,
        transaction=transaction,
        dseq=host.last_dseq,
        epoch=host.epoch,
        batch_id=batch_id,
        at=now(),
    )


def _commands(jobs: Sequence[Job], attempts: Sequence[Attempt], execution: Execution) -> list[Do]:
    by_index = {job.index: attempt.id for job, attempt in zip(jobs, attempts, strict=True)}
    commands = []
    before_s = 0.0
    for job, attempt in zip(jobs, attempts, strict=True):
        part = _part(job, attempt, by_index, execution)
        command = dispatch.command_of(job, attempt, [])
        ttl_s = _WAIT_S + before_s + execution.max_offline_s
        commands.append(msgspec.structs.replace(command, batch=part, ttl_s=ttl_s))
        before_s += command.timeout_s
    return commands


def _part(
    job: Job, attempt: Attempt, by_index: Mapping[int, UUID], execution: Execution
) -> BatchPart:
    if attempt.batch_id is None:
        raise ValueError(attempt.id)
    return BatchPart(
        batch_id=attempt.batch_id,
        after=[by_index[index] for index in job.after if index in by_index],
        meets=None if job.meets is None else by_index[job.meets],
        on_disconnect=execution.on_disconnect,
        max_offline_s=execution.max_offline_s,
    )


def _views(jobs: Sequence[Job]) -> list[ResourceView]:
    ids: set[UUID] = set()
    for job in jobs:
        ids |= set(operations.touched_ids(operations.from_json(job.operation)))
        ids |= {UUID(node) for node in job.locks}
    rows = resource_selectors.rows(ids)
    states = crutd_selectors.snapshot(rows)
    for job in jobs:
        states = with_place(operations.from_json(job.operation), states)
    return [dispatch.view_of(row, states[row.id]) for row in rows]


def settle_batch(attempt: Attempt) -> None:
    """Ring for a batch no more once its host has told of every member."""
    if attempt.batch_id is None:
        return
    open_members = Attempt.objects.filter(
        batch_id=attempt.batch_id, job__state=JobState.DISPATCHED.value
    )
    if not open_members.exists():
        dispatch.settle_outbox(attempt.batch_id, ["batch"])


def recall_run(run: Run, *, issued_by: str, is_whole: bool = False) -> int:
    """Ask the hosts to give back what they have not begun of a run.

    Args:
        run: Which.
        issued_by: Who asks; empty: the server.
        is_whole: What went alone, too. Else the batches alone: of them nobody knows how much
            will follow.

    Returns:
        How many jobs were asked for.

    Effect:
        None on matter. A job that the host gives back is held; one that has begun goes on.
    """
    tried = [selectors.last_attempt(job) for job in Job.objects.filter(run=run, state__in=_WAITING)]
    found = [one for one in tried if one is not None and (is_whole or one.batch_id is not None)]
    for attempt in found:
        dispatch.send_cancel(attempt, issued_by=issued_by, is_recall=True)
    return len(found)


def recall_corrected(calibration_id: UUID, *, issued_by: str) -> int:
    """Ask the hosts to give back what they have not begun with a calibration's numbers.

    Returns:
        How many jobs were asked for.

    Effect:
        As `recall_run`: a job that is given back is held, and does not go again with them.
    """
    corrected = [{"calibration_id": str(calibration_id)}]
    jobs = Job.objects.filter(state__in=_WAITING, corrections__contains=corrected)
    found = [one for one in map(selectors.last_attempt, jobs) if one is not None]
    for attempt in found:
        dispatch.send_cancel(attempt, issued_by=issued_by, is_recall=True)
    return len(found)
