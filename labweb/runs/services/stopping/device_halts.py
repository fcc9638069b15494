"""What a host's halt of a device means for the record, and for the runs that counted on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any
from uuid import UUID

from django.db.transaction import on_commit

from labweb.common.clock import now
from labweb.crutd import services as crutd_services
from labweb.domain.errors import Finding, StateError
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.halts.halted_setpoints import (
    DEVICE_STOPPED,
    INTERRUPTED,
    RUN_ABORTED,
    STOPPED,
    WITH_ACTION,
    is_halt_certain,
    leaves_standing,
    voided,
    was_halted_since,
)
from labweb.domain.runs.halts.vanished_setpoints import VANISHED, gone_of
from labweb.domain.runs.states.job_states import JobState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device, EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.models import Attempt, Job, Run
from labweb.runs.services.execution.host_batches import recall_run
from labweb.runs.services.execution.job_states import announce, refresh_run

_WHY = {
    STOPPED: "the lab was stopped",
    RUN_ABORTED: "the run that had set it was aborted",
    DEVICE_STOPPED: "a person stopped it",
    INTERRUPTED: "the process of its line died in an action",
}


def take_halt(host: EdgeHost, event: EdgeEvent) -> None:
    """Void what a halted device was set to, and pause the runs whose earlier steps had set it.

    Raises:
        StateError: The host does not serve the device.

    Effect:
        On the record only: the same rule as the host's, on the server's own rows. A difference
        opens a ticket.
    """
    device = enrollment_selectors.find_device(UUID(event.body["device_id"]))
    if device.host_id != host.id:
        raise StateError(f"{device.name} is not one of its devices", code="host.unknown_device")
    code = str(event.body["code"])
    _take_from_runs(device, code)
    _note_found(host, event.body)
    why = f"{device.name} was halted: {_why(code)}"
    _void(host, device, event.body, why, voided)


def _void(
    host: EdgeHost,
    device: Device,
    body: Mapping[str, Any],
    why: str,
    rule: Callable[[Mapping[str, Any]], dict[str, None]],
) -> None:
    """Apply to the device's resources what the host has made unknown on its own record."""
    told, revs = body.get("data") or {}, body.get("revs") or {}
    nodes = {UUID(node) for node in device.nodes.values()}
    for row in resource_selectors.rows_for_update(nodes).values():
        gone = rule(row.data)
        known = told.get(str(row.id))
        if known is not None and dict(known) != gone:
            _doubt_halt(host, row.id, known, gone)
        if gone or known:
            rev = max(row.rev + 1, int(revs.get(str(row.id), 0)))
            crutd_services.note_halt(row, gone, rev=rev, code=str(body["code"]), message=why)


def take_lost(host: EdgeHost, event: EdgeEvent) -> None:
    """Void what an action had set and is gone, and pause its run with the question of a halt.

    Of a run that has ended a ticket asks a person to look at the device.

    Raises:
        StateError: The host does not serve the device.

    Effect:
        On the record only: the same rule as the host's, on the server's own rows. A difference
        opens a ticket.
    """
    device = enrollment_selectors.find_device(UUID(event.body["device_id"]))
    if device.host_id != host.id:
        raise StateError(f"{device.name} is not one of its devices", code="host.unknown_device")
    code, message = str(event.body["code"])[:20], str(event.body["message"])
    attempt = Attempt.objects.filter(pk=UUID(event.body["action_id"]), host=host).first()
    if attempt is not None:
        job = selectors.job_for_update(attempt.job_id)
        is_last = not job.attempts.filter(dseq__gt=attempt.dseq).exists()
        is_live = job.run.state in selectors.LIVE
        if is_last and is_live and job.state == JobState.COMPLETE.value and not job.halted_by:
            job.halted_by, job.message = code, message
            job.save(update_fields=["halted_by", "message"])
            _pause(selectors.run_for_update(job.run_id), "lost")
            on_commit(partial(announce, job.run_id, job.id))
        elif is_last and not is_live:
            _ask_about_left(device, job, attempt, message)
    action = str(event.body["action"])
    why = f"{device.name}: {message}"
    _void(host, device, event.body, why, lambda data: gone_of(data, action))


def _ask_about_left(device: Device, job: Job, attempt: Attempt, message: str) -> None:
    """Ask a person to look at a device that a run has left on, and that nobody works with."""
    text = (
        f"run #{job.run.number} has ended and left {device.name} on. Now {message}. Look at "
        f"{device.name}, and stop it on its page unless somebody uses it"
    )
    detail = {"device_id": str(device.id), "transaction_id": str(attempt.transaction_id)}
    crutd_services.open_ticket(device.host.lab, "device.left_on", text, detail)


def _note_found(host: EdgeHost, body: Mapping[str, Any]) -> None:
    """Tell with a doubt how its device was found, where it was halted only later."""
    if not body.get("message") or not body.get("action_id"):
        return
    told = Attempt.objects.filter(pk=UUID(body["action_id"]), host=host).first()
    job = None if told is None else selectors.job_for_update(told.job_id)
    if job is None or job.state != JobState.IN_DOUBT.value:
        return
    report = job.evidence.get("report") or {}
    seen = {**(report.get("evidence") or {}), **(body.get("evidence") or {})}
    job.message = f"{job.message}. It answers again: {body['message']}"
    job.evidence = {**job.evidence, "report": {**report, "evidence": seen}}
    job.save(update_fields=["message", "evidence"])
    on_commit(partial(announce, job.run_id, job.id))


def _why(code: str) -> str:
    return _WHY.get(code, "one of its actions was halted")


def _doubt_halt(
    host: EdgeHost, resource_id: UUID, known: Mapping[str, Any], gone: Mapping[str, Any]
) -> None:
    text = "edge and server say otherwise what a halt has made unknown"
    detail = {"resource_id": str(resource_id), "edge": dict(known), "server": dict(gone)}
    crutd_services.open_ticket(host.lab, "reconcile.drift", text, detail)


def _take_from_runs(device: Device, code: str) -> None:
    """Mark the completed jobs whose effect is gone, and pause their runs."""
    live = Run.objects.filter(state__in=selectors.LIVE, jobs__device=device).order_by("pk")
    runs = {run.pk: run for run in live.select_for_update(of=("self",), no_key=True)}
    if not runs:
        return
    mine = Job.objects.filter(run__in=list(runs), device=device)
    lost = selectors.standing_jobs(mine).get(device.id, [])
    Job.objects.filter(pk__in=[job.pk for job in lost]).update(halted_by=code)
    for run_id in sorted({job.run_id for job in lost}):
        _pause(runs[run_id])


def undo_settled(job: Job, attempt: Attempt) -> None:
    """Void what a job set of which a person says that it happened, if a halt came after it.

    Effect:
        On the record only, as where its host settles it. The run asks about it.
    """
    if not was_halted_since(selectors.halts_since(attempt, job.device)):
        return
    nodes = {UUID(node) for node in job.device.nodes.values()}
    why = f"{job.device.name} was halted: {_why(WITH_ACTION)}"
    for row in resource_selectors.rows_for_update(nodes).values():
        gone = voided(row.data)
        if gone:
            crutd_services.note_halt(row, gone, rev=row.rev + 1, code=WITH_ACTION, message=why)
    undo_job(job)


def undo_job(job: Job) -> None:
    """Mark a job that completes though its device was halted since it began.

    Before its run is looked at: one whose last step this is has not ended.
    """
    if leaves_standing(job.action, job.args):
        job.halted_by = WITH_ACTION
        job.save(update_fields=["halted_by"])
        _pause(selectors.run_for_update(job.run_id))


def _pause(run: Run, kind: str = "halted") -> None:
    """Pause a run, unless somebody has given it up: then nothing of it begins anyhow."""
    if run.is_given_up:
        return
    if all(one["kind"] != kind for one in run.pause_reasons):
        entry = {"kind": kind, "by": "", "at": now().isoformat()}
        run.pause_reasons = [*run.pause_reasons, entry]
        run.save(update_fields=["pause_reasons"])
    recall_run(run, issued_by="", is_whole=True)
    refresh_run(run.pk)


def check_halted(run: Run) -> None:
    """Refuse to go on while something that a completed step had set is gone.

    Raises:
        StateError: `findings` name each step with its device.
    """
    lost = selectors.halted_jobs(run)
    if lost:
        raise StateError(
            f"run #{run.number} cannot go on: {_listed(lost)}. Do each again, or say that the run "
            "goes on without it",
            code="run.halted",
            context={"job_ids": [str(job.id) for job in lost]},
            findings=[_finding(job) for job in lost],
        )


def _listed(jobs: Sequence[Job]) -> str:
    return "; ".join(f"{job.sentence!r} {_undone(job)}, since {why_taken(job)}" for job in jobs)


def _finding(job: Job) -> Finding:
    text = f"{job.sentence!r} was done, and {_undone(job)}: since {why_taken(job)}"
    context = {"job_id": str(job.id), "device_id": str(job.device_id), "code": job.halted_by}
    return Finding("run.halted", text, job.step_id, context)


def _undone(job: Job) -> str:
    """Say no more than is known: what a foreign node does after a halt, its maker knows."""
    return "is undone" if is_halt_certain(job.action) else "may be undone"


def why_taken(job: Job) -> str:
    """Say why what a completed job had set is gone: a halt of its device, or a loss."""
    if job.halted_by == VANISHED:
        return f"{job.device.name} does not keep what was set: {job.message}"
    return f"{job.device.name} was halted, {_why(job.halted_by)}"
