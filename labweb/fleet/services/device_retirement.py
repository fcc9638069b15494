"""Retire a device: nothing of it acts, waits or holds anything, and then it is no more."""

from __future__ import annotations

from collections.abc import Iterator
from uuid import UUID

from django.db.transaction import atomic

from labweb.accounts.selectors import User
from labweb.crutd import services as crutd_services
from labweb.crutd.services.device_removal import Leaving
from labweb.domain.errors import Finding, LockedError, PreconditionError
from labweb.domain.runs.states.job_states import AT_EDGE, JobState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import Device
from labweb.runs.selectors import Job
from labweb.runs.selectors.open_jobs import open_jobs

_SENT = frozenset(state.value for state in (*AT_EDGE, JobState.IN_DOUBT))


@atomic
def retire_device(device_id: UUID, *, actor: User, reason: str, outcome: str = "") -> Device:
    """End a device, and say what becomes of the thing that it was taken up from.

    Args:
        device_id: Which.
        actor: Who says so.
        reason: Why.
        outcome: `quarantined`, `ignored` or `rejected`, for one that nobody has admitted since
            it was taken up; "": what it was taken up from, if anything, is in the inbox again.

    Raises:
        NotFoundError: There is no such device.
        ForbiddenError: The actor may not admit where it stands; with an outcome, in the lab.
        DefinitionError: No reason was given, or this is no outcome.
        StateError: It is retired, or has no candidate for this outcome; or its key is to be
            rejected, and another device in use has it.
        LockedError: Somebody uses a part of it just now.
        PreconditionError: `device.in_use`: a job of it acts, waits or is in doubt, or a part holds
            something, is connected, reserved or quarantined; `findings` list each.

    Effect:
        None on matter. Its own parts, which are empty, are in the Archive; what it acted through
        besides stays where it is. Its host serves it no more.
    """
    # Locked, as for every dispatch: nothing is sent to the device, or ingested of it, meanwhile.
    host = enrollment_selectors.host_for_update(enrollment_selectors.find_device(device_id).host_id)
    device = enrollment_services.hold_to_retire(
        device_id, actor=actor, reason=reason, outcome=outcome
    )
    if device.host_id != host.id:
        text = f"{device.name} went to another host just now: ask again"
        raise LockedError(text, code="device.busy")
    leaving = crutd_services.hold_leaving(device)
    findings = [*_check_jobs(leaving), *crutd_services.check_leaving(leaving)]
    if findings:
        told = "; ".join(finding.message for finding in findings)
        text = f"{device.name} cannot be retired yet: {told}"
        raise PreconditionError(text, code="device.in_use", findings=findings)
    note = f"{device.name} is retired: {reason.strip()}"
    crutd_services.take_out(leaving, actor_id=actor.pk, note=note)
    enrollment_services.end_device(
        device, actor=actor, reason=reason, outcome=outcome, gone=leaving.within
    )
    return device


def _check_jobs(leaving: Leaving) -> Iterator[Finding]:
    """List the jobs that act, wait or are in doubt: its own, and those that use its parts."""
    for job in open_jobs(leaving.device.lab):
        if job.device_id == leaving.device.pk or leaving.within & set(map(UUID, job.locks)):
            yield Finding("device.has_job", _told(job), str(job.pk), {"run_id": str(job.run_id)})


def _told(job: Job) -> str:
    named = f"run #{job.run.number}, {job.sentence}"
    if job.state == JobState.IN_DOUBT:
        return f"{named}: its outcome is in doubt, say first what happened"
    if job.state in _SENT:
        return f"{named}: it is under way, let it end or stop the run"
    return f"{named}: it waits, cancel the run or let it end"
