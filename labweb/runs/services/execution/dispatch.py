"""From a queued job to a signed command at the host's door."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from django.db import Error as DatabaseProblem
from django.db.transaction import atomic, on_commit

from labweb.calibration import selectors as calibration_selectors
from labweb.common import faults, queue
from labweb.common.clock import new_id, now, tick
from labweb.common.database.prepared_queries import Question, together, update_row
from labweb.common.dispatcher_wakeup import wake_dispatcher
from labweb.common.signatures import signing
from labweb.crutd import services as crutd_services
from labweb.domain.calibration.correction import Correction
from labweb.domain.crutd import operations
from labweb.domain.crutd.settlement import ResourceState
from labweb.domain.errors import LockedError, PreconditionError
from labweb.domain.messages.commands import (
    Cancel,
    Command,
    Do,
    Reset,
    Resolve,
    ResourceView,
    StandingView,
)
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.runs.dispatch.command_outbox import (
    RING_AGAIN_AFTER_S,
    BatchDraft,
    signed_batch,
    stamped,
)
from labweb.domain.runs.dispatch.job_scheduler import JobView
from labweb.domain.runs.states.job_states import JobState, Mover
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import Device, EdgeHost
from labweb.resources.selectors import Lab, Resource
from labweb.runs import selectors
from labweb.runs.models import Attempt, Job, Outbox, Run
from labweb.runs.services.driver_switches import switch_before
from labweb.runs.services.execution import job_states, run_holds
from labweb.runs.services.execution.failure_containment import doubt_command

logger = logging.getLogger(__name__)

RING_AGAIN_AFTER = timedelta(seconds=RING_AGAIN_AFTER_S)

_TIMEOUT_S = 120.0

# Written out: it is on the way of every click.
_KEEP = """
WITH numbered AS (
    UPDATE enrollment_edgehost SET last_dseq = %(dseq)s WHERE id = %(host)s
), tried AS (
    INSERT INTO runs_attempt (id, job_id, number, host_id, transaction_id, dseq, epoch, at)
    VALUES (%(id)s, %(job)s, %(number)s, %(host)s, %(transaction)s, %(dseq)s, %(epoch)s, %(at)s)
)
INSERT INTO runs_outbox (host_id, action_id, kind, body, at, publish_count)
VALUES (%(host)s, %(id)s, 'do', %(body)s::jsonb, %(at)s, 0)
RETURNING id
"""


def dispatch_job(run_id: UUID, view: JobView) -> bool:
    """Lock everything a job needs and write its command into the outbox.

    Returns:
        False when it has to wait for a lock; nothing was written then. A precondition
        that fails now rejects the job, which pauses its run.
    """
    try:
        with atomic():
            return _dispatch(run_id, view)
    except LockedError as error:
        logger.debug("job %s waits: %s", view.id, error.message)
        run_holds.note_waiting(run_id, error)
        return False
    except PreconditionError as error:
        job_states.hold_job(view.id, error)
        return False


def dispatch_on(run_id: UUID, view: JobView, device: Device, **fields: object) -> bool:
    """Send a job on one of the devices that may do it; `fields` are what the job is there.

    Returns:
        False when the job is not to be sent any more; nothing was written.

    Raises:
        LockedError: Something of it is in use. Nothing was written.
        PreconditionError: It may not go now. Nothing was written.
    """
    with atomic():
        there = replace(view, host_id=device.host_id)
        return _dispatch(run_id, there, {"device": device, **fields})


def _dispatch(run_id: UUID, view: JobView, fields: Mapping[str, Any] | None = None) -> bool:
    held = hold_for_dispatch(run_id, view, fields)
    if held is None:
        return False
    host, run, job = held.host, held.run, held.job
    granted = run_holds.ask(run, [job])
    switch_before(host, [job])
    check_calibrations([job])
    operation = operations.from_json(job.operation)
    try:
        found = crutd_services.hold_to_open(
            operation,
            job.run.lab,
            [UUID(node) for node in job.locks],
            asker=crutd_services.Asker(actor_id=run.created_by_id, run_id=run.pk),
            job_id=job.id,
            granted=granted.modes,
        )
    except LockedError as error:
        raise granted.in_line(error) from error
    host.last_dseq += 1
    attempt = Attempt(
        id=new_id(),
        job=job,
        number=held.number,
        host=host,
        transaction=found.row,
        dseq=host.last_dseq,
        epoch=host.epoch,
        at=now(),
    )
    command = command_of(
        job, attempt, [view_of(row, found.states[row.id]) for row in found.rows.values()]
    )
    noting = job_states.noting_sent(run)
    _, ((row_id,),), *_ = together(
        found.opening,
        _keeping(attempt, command),
        job_states.moving(job, JobState.DISPATCHED, Mover.SCHEDULER, **(fields or {})),
        *(noting or ()),
        *granted.writing,
    )
    body = msgspec.to_builtins(command)
    row = Outbox(pk=row_id, host=host, action_id=attempt.id, kind="do", body=body)
    # The command goes as soon as it is on disk; where this fails, the relay finds it.
    on_commit(partial(_publish, row), robust=True)
    on_commit(partial(job_states.announce, run.id, job.id))
    if noting is None:
        job_states.refresh_run(run.pk)
    return True


@dataclass(frozen=True, slots=True)
class ToDispatch:
    """A job that is locked with its run and its host."""

    host: EdgeHost
    run: Run
    job: Job
    number: int
    """Of its next try."""


def hold_for_dispatch(
    run_id: UUID, view: JobView, fields: Mapping[str, Any] | None = None
) -> ToDispatch | None:
    """Lock host, run and job in the order in which everybody does; None: it may not go now.

    `fields` are what the job is on the device that was chosen for it.

    Raises:
        LockedError: Its device is to be halted first. Nothing was written.
    """
    hosts, runs, jobs, numbers, halting = together(
        enrollment_selectors.HOST_TO_LOCK.asking(id=view.host_id),
        selectors.RUN_TO_LOCK.asking(id=run_id),
        selectors.JOB_TO_LOCK.asking(id=view.id),
        selectors.asking_number(view.id),
        selectors.HALTING_AT.asking(host=view.host_id),
    )
    if not (hosts and runs and jobs):
        return None
    host, run, job = hosts[0], runs[0], jobs[0]
    for name, value in (fields or {}).items():
        setattr(job, name, value)
    is_elsewhere = job.device.host_id != host.pk
    if job.state != JobState.QUEUED.value or run.pause_reasons or is_elsewhere:
        return None
    job_states.check_not_halting([job], {device_id for (device_id,) in halting})
    return ToDispatch(host, run, job, numbers[0])


def check_calibrations(jobs: Sequence[Job]) -> None:
    """Refuse to send numbers that a calibration made right and that are not right any more.

    Raises:
        PreconditionError: A calibration does not hold now, or is not as sure as a step needs.
    """
    at = now()
    findings = [
        one
        for job in jobs
        if job.corrections
        for one in calibration_selectors.findings_of_sending(job.device, job.corrections, at=at)
    ]
    if findings:
        text = "; ".join(dict.fromkeys(one.message for one in findings))
        raise PreconditionError(text, code=findings[0].code, findings=findings)


def _keeping(attempt: Attempt, command: Do) -> Question[Any]:
    """Return what writes the number that a host has come to, a try that has it, and its command."""
    values: dict[str, Any] = {
        "id": attempt.id,
        "job": attempt.job_id,
        "number": attempt.number,
        "host": attempt.host_id,
        "transaction": attempt.transaction_id,
        "dseq": attempt.dseq,
        "epoch": attempt.epoch,
        "at": attempt.at,
        "body": msgspec.json.encode(command).decode(),
    }
    return Question(_KEEP, values, tuple)


def command_of(job: Job, attempt: Attempt, views: list[ResourceView]) -> Do:
    """Return the command of one try of a job."""
    spec = enrollment_selectors.specs_of([job.device])[job.device_id]
    timeout_s = spec.action(job.action).timeout_s or _TIMEOUT_S
    return Do(
        host_id=attempt.host_id,
        epoch=attempt.epoch,
        dseq=attempt.dseq,
        action_id=attempt.id,
        job_id=job.id,
        run_id=job.run_id,
        attempt=attempt.number,
        line="",
        device_id=job.device_id,
        driver_digest=job.device.driver.digest,
        action=job.action,
        args=job.args,
        corrections=msgspec.convert(job.corrections, list[Correction]),
        operation=job.operation,
        pre=job.pre,
        post=job.post,
        resources=views,
        timeout_s=timeout_s,
        issued_by=str(job.run.created_by_id),
    )


def view_of(row: Resource, state: ResourceState) -> ResourceView:
    """Return a resource as its host is told of it."""
    return ResourceView(
        id=row.id,
        name=row.name,
        kind=row.kind,
        rev=row.rev,
        parent_id=row.parent_id,
        contents={str(lot): amount for lot, amount in state.contents.items()},
        capacity_nl=state.capacity_nl,
        dead_volume_nl=state.dead_volume_nl,
        data=row.data,
        is_archived=row.is_archived,
        there=[StandingView(id=one.id, name=one.name, kind=one.kind) for one in state.there],
        sites_count=state.sites_count,
    )


def _keep(host: EdgeHost, action_id: UUID, command: Command) -> None:
    body = msgspec.to_builtins(command)
    Outbox.objects.create(host=host, action_id=action_id, kind=body["t"], body=body, at=now())


def post(host: EdgeHost, action_id: UUID, command: Command) -> None:
    """Keep a command that did not come from the dispatcher, and wake it to send that."""
    _keep(host, action_id, command)
    wake_dispatcher()


def send_resolution(attempt: Attempt, **fields: object) -> None:
    """Put a person's answer about an action in doubt into the outbox."""
    host = attempt.host
    command = msgspec.convert(
        {
            "t": "resolve",
            "host_id": str(host.id),
            "epoch": host.epoch,
            "dseq": attempt.dseq,
            "action_id": str(attempt.id),
            **fields,
        },
        Resolve,
    )
    post(host, attempt.id, command)


def send_cancel(attempt: Attempt, *, issued_by: str, is_recall: bool = False) -> None:
    """Ask the host not to start an action; for a recall, to give it back."""
    waiting = Outbox.objects.filter(
        action_id=attempt.id, kind="cancel", body__is_recall=is_recall, settled_at__isnull=True
    )
    if waiting.exists():
        return
    command = Cancel(
        host_id=attempt.host_id,
        epoch=attempt.epoch,
        dseq=attempt.dseq,
        action_id=attempt.id,
        issued_by=issued_by,
        is_recall=is_recall,
    )
    post(attempt.host, attempt.id, command)


def send_reset(host: EdgeHost, *, stop_id: UUID, reason: str, issued_by: str) -> None:
    """Ask a host to release one stop."""
    command = Reset(
        host_id=host.id,
        epoch=host.epoch,
        dseq=host.last_dseq,
        stop_id=stop_id,
        reason=reason,
        issued_by=issued_by,
    )
    post(host, new_id(), command)


def publish_outbox() -> int:
    """Ring the doorbell for every command that its host has not answered yet.

    The epoch is put on and the command is signed at this moment, so that a command
    written before a reconnect is valid after it. Two relays never send the same row. One that
    cannot be sent is told of, tried again in its turn, and keeps no other back.

    Returns:
        How many were sent, or could not be.

    Raises:
        django.db.Error: The database is away, or refuses to note what was sent.
    """
    with atomic():
        rows = selectors.due_outbox(now() - RING_AGAIN_AFTER)
        for row in rows:
            try:
                _publish(row)
            except DatabaseProblem:
                raise
            except Exception as error:  # noqa: BLE001 - whatever it is, it is told with its row
                doubt_command(row, error)
                Outbox.objects.filter(pk=row.pk).update(published_at=now())
    return len(rows)


def _publish(row: Outbox) -> None:
    message = signed(row, row.host.epoch)
    faults.point("relay.before_ring")
    if row.host.has_broker and not queue.ring(row.host_id, message):
        logger.warning("the broker is away: telling host %s directly", row.host.name)
    if row.publish_count or not row.host.has_broker:
        nudge = {"type": "edge.nudge", "signed": msgspec.to_builtins(message)}
        enrollment_services.tell_host(row.host_id, nudge)
    faults.point("relay.after_ring")
    row.published_at, row.publish_count = now(), row.publish_count + 1
    update_row(row, "published_at", "publish_count")


def signed(row: Outbox, epoch: int) -> Signed:
    """Return the command of a row as it goes to its host in a session."""
    if row.kind == "batch":
        draft = msgspec.convert(row.body, BatchDraft)
        return signing.sign(signed_batch(draft, epoch, signing.sign, at=now(), sent=tick()))
    return signing.sign(stamped(msgspec.convert(row.body, Command), epoch, at=now(), sent=tick()))


def void_resets(lab: Lab) -> None:
    """Give up resets that no host has answered: a newer stop holds."""
    Outbox.objects.filter(host__lab=lab, kind="reset", settled_at__isnull=True).update(
        settled_at=now()
    )


def settle_outbox(action_id: UUID, kinds: list[str]) -> None:
    """Mark commands about an action as answered."""
    Outbox.objects.filter(action_id=action_id, kind__in=kinds, settled_at__isnull=True).update(
        settled_at=now()
    )
