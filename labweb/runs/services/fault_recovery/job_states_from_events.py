"""The state of each job as the events of its host tell it, and jobs written anew from them."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from itertools import chain
from uuid import UUID

from django.db import connection

from labweb.crutd.selectors import events_of
from labweb.domain.errors import Finding
from labweb.domain.runs.host_journal.action_states import resolve
from labweb.domain.runs.host_link.host_session import FENCED_CODE
from labweb.domain.runs.states.job_state_from_events import job_state, server_state
from labweb.domain.runs.states.job_states import JobState
from labweb.resources.selectors import Lab
from labweb.runs.models import Attempt, HostEvent, Job, Run

FENCED = frozenset({"host.quarantined", "host.revoked", FENCED_CODE})


def job_differences(lab: Lab) -> Iterator[Finding]:
    """Yield every job that is not in the state that its host's events tell."""
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
    tells of them; one that a person has queued anew, or that its host gave back, is so again
    until its next try, and keeps the state it has where that is one of them.
    """
    last = {
        attempt.job_id: attempt
        for attempt in Attempt.objects.filter(job__run__lab=lab)
        .select_related("job")
        .order_by("number")
    }
    events: dict[UUID | None, list[tuple[str, dict[str, object]]]] = {}
    rows = HostEvent.objects.filter(action_id__in=[one.pk for one in last.values()])
    for action_id, kind, body in rows.order_by("id").values_list("action_id", "kind", "body"):
        events.setdefault(action_id, []).append((kind, body))
    fenced, anew = _fenced(lab), _queued_anew(lab)
    found = {}
    for job_id, attempt in last.items():
        current = JobState(attempt.job.state)
        if job_id in anew and anew[job_id] >= attempt.at:
            found[job_id] = server_state(current)
        elif attempt.transaction_id in fenced:
            found[job_id] = _after_fence(attempt.job)
        elif attempt.pk in events:
            told = job_state(events[attempt.pk])
            found[job_id] = server_state(current) if told is JobState.HELD else told
    return found


def _fenced(lab: Lab) -> set[UUID]:
    """Return the transactions of which an event says that their host was fenced off."""
    rows = events_of(lab).filter(body__code__in=FENCED)
    return set(rows.values_list("transaction_id", flat=True))


def _after_fence(job: Job) -> JobState:
    """Return where a job stands whose host can never tell: in doubt until a person has."""
    told = job.evidence.get("resolution") or {}
    answer = resolve(str(told.get("answer")), moved_nl=told.get("moved_nl"))
    return JobState.IN_DOUBT if answer is None else JobState(answer[0].value)


def _queued_anew(lab: Lab) -> dict[UUID, datetime]:
    """Return when a person had each job carried out again last, as their run keeps it."""
    choices = chain.from_iterable(
        Run.objects.filter(lab=lab).exclude(recoveries=[]).values_list("recoveries", flat=True)
    )
    return {
        UUID(one["job_id"]): datetime.fromisoformat(one["at"])
        for one in choices
        if one["choice"] == "retry"
    }


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
