"""Compare the whole record with its events, and write it anew from them."""

from __future__ import annotations

from collections.abc import Iterator
from uuid import UUID

from django.db import connection
from django.db.transaction import atomic

from labweb.crutd import services as crutd_services
from labweb.crutd.selectors import events_of
from labweb.crutd.selectors.past import rebuild_differences
from labweb.domain.errors import Finding, ReconcileError
from labweb.domain.runs.history import job_state
from labweb.domain.runs.job import JobState
from labweb.resources.selectors import Lab
from labweb.runs.models import Attempt, HostEvent, Job

FENCED = "host.quarantined"


def differences(lab: Lab) -> list[Finding]:
    """List every way in which tree, ledger, transactions and jobs are not what events tell.

    Raises:
        ReconcileError: The import or an event cannot be read.
    """
    return [*rebuild_differences(lab), *_job_differences(lab)]


def _job_differences(lab: Lab) -> Iterator[Finding]:
    told = told_states(lab)
    for job in Job.objects.filter(run__lab=lab, pk__in=list(told)).order_by("pk"):
        state = told[job.pk]
        if job.state != state.value:
            text = f"{job.sentence}: it is {job.state}, its host's events tell {state.value}"
            yield Finding("rebuild.job", text, str(job.pk))


def told_states(lab: Lab) -> dict[UUID, JobState]:
    """Return the state of each job of which a host has told, by the last try.

    A job of a host that was fenced off is in doubt until a person has answered, whatever its
    host had told before. Jobs that were never dispatched are the server's own, and no event
    tells of them.
    """
    last = {
        attempt.job_id: attempt
        for attempt in Attempt.objects.filter(job__run__lab=lab).order_by("number")
    }
    events: dict[UUID | None, list[tuple[str, dict[str, object]]]] = {}
    rows = HostEvent.objects.filter(action_id__in=[one.pk for one in last.values()])
    for action_id, kind, body in rows.order_by("id").values_list("action_id", "kind", "body"):
        events.setdefault(action_id, []).append((kind, body))
    fenced = _fenced(lab)
    found = {}
    for job_id, attempt in last.items():
        if attempt.transaction_id in fenced:
            found[job_id] = JobState.IN_DOUBT
        elif attempt.pk in events:
            found[job_id] = job_state(events[attempt.pk])
    return found


def _fenced(lab: Lab) -> set[UUID]:
    """Return the transactions whose last event says that their host was fenced off."""
    rows = events_of(lab).order_by("seq").values_list("transaction_id", "body__code")
    last = dict(rows.iterator())
    return {key for key, code in last.items() if code == FENCED}


@atomic
def rebuild(lab: Lab) -> None:
    """Write tree, lots, ledger, and the states of transactions and jobs from what events tell.

    Raises:
        ReconcileError: As `crutd.services.rebuild`, or the events of a host cannot be. Nothing
            was written.
        StateError: Something is under way.

    Effect:
        None on matter.
    """
    crutd_services.rebuild(lab)
    write_job_states(lab)
    left = differences(lab)
    if left:
        raise ReconcileError(left[0].message, code="rebuild.stray", findings=left)


def write_job_states(lab: Lab) -> None:
    """Give each job the state that its host told."""
    told = told_states(lab)
    with connection.cursor() as cursor:
        cursor.execute("SET CONSTRAINTS ALL IMMEDIATE")
        cursor.execute("ALTER TABLE runs_job DISABLE TRIGGER runs_job_step")
        for job in Job.objects.filter(run__lab=lab, pk__in=list(told)):
            if job.state != told[job.pk].value:
                Job.objects.filter(pk=job.pk).update(state=told[job.pk].value)
        cursor.execute("ALTER TABLE runs_job ENABLE TRIGGER runs_job_step")
        cursor.execute("SET CONSTRAINTS ALL DEFERRED")
