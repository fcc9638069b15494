"""Take a connection off the physical graph: no run that is planned goes through it any more."""

from __future__ import annotations

from collections.abc import Iterator
from uuid import UUID

from django.db.models import Q
from django.db.transaction import atomic

from labweb.accounts.selectors import User
from labweb.crutd import services as crutd_services
from labweb.crutd.selectors import Transaction
from labweb.domain.crutd.operations import Disconnect
from labweb.domain.errors import Finding, PreconditionError
from labweb.domain.runs.states.job_states import AT_EDGE, FINAL, JobState
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs import selectors
from labweb.runs.models import Job

_FINAL = [state.value for state in FINAL]
_SENT = [state.value for state in (*AT_EDGE, JobState.IN_DOUBT)]


@atomic
def disconnect(operation: Disconnect, *, actor: User, note: str) -> Transaction:
    """Take a connection off, as a person has done it.

    Raises:
        LockedError: One of its ends is in use, or reserved by somebody else.
        PreconditionError: A job that acts, waits or is in doubt uses both ends; the connection is
            not as it was shown; it is a device's own; or something may be in it. `findings` list
            each.

    Effect:
        None on matter. No way goes through it any more. Nothing was written if it raises.
    """
    # Locked, as for every start: no run is planned through it meanwhile.
    lab = resource_selectors.lab_for_update(resource_selectors.the_lab().pk)
    findings = check_disconnect(operation, lab=lab, actor_id=actor.pk)
    if any(one.code == "device.has_job" for one in findings):
        raise PreconditionError(findings[0].message, code=findings[0].code, findings=findings)
    return crutd_services.carry_out(operation, lab=lab, actor_id=actor.pk, note=note)


def check_disconnect(operation: Disconnect, *, lab: Lab, actor_id: UUID | None) -> list[Finding]:
    """List all that speaks against it now, the jobs of runs included."""
    found = crutd_services.check_operation(operation, lab=lab, actor_id=actor_id)
    return [*_check_jobs(operation, lab), *found]


def _check_jobs(operation: Disconnect, lab: Lab) -> Iterator[Finding]:
    """List the jobs that act, wait or are in doubt, and lock what it joins."""
    ends = [str(operation.source_id), str(operation.target_id)]
    rows = Job.objects.filter(run__lab=lab, locks__contains=ends).exclude(state__in=_FINAL)
    rows = selectors.with_runs(rows.filter(Q(run__ended_at__isnull=True) | Q(state__in=_SENT)))
    found = list(rows.order_by("run__number", "index"))
    joined = [operation.source_id, operation.target_id]
    names = resource_selectors.names(joined) if found else {}
    for job in found:
        way = " to ".join(names[end] for end in joined)
        text = (
            f"run #{job.run.number}, {job.sentence}, goes from {way}: let the run end, or stop it"
        )
        yield Finding("device.has_job", text, str(job.pk), {"run_id": str(job.run_id)})
