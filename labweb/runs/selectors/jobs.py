"""Reads of jobs, their attempts and what hosts said of them."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from datetime import datetime
from uuid import UUID

from django.db.models import Q, QuerySet, UUIDField

from labweb.accounts import selectors as account_selectors
from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.errors import NotFoundError
from labweb.domain.runs.states.job_states import AT_EDGE, JobState
from labweb.enrollment.selectors import Device, EdgeHost
from labweb.resources.selectors import Lab
from labweb.runs.models import Attempt, HostEvent, Job, Outbox, Run
from labweb.runs.selectors.jobs_without_plans import with_runs
from labweb.runs.selectors.runs import visible_runs


def jobs_of(run: Run) -> QuerySet[Job]:
    """Jobs of a run in plan order, with devices."""
    return run.jobs.select_related("device__host").order_by("index")


JOBS_OF = Prepared(
    lambda: (
        Job.objects.filter(run_id=Given("run", UUIDField()))
        .select_related("device__host")
        .order_by("index")
    )
)
"""The same, for a page that asks more besides."""


def jobs_with_runs(lab: Lab, seen: Collection[UUID], ids: Iterable[UUID]) -> QuerySet[Job]:
    """Return those of the jobs whose runs use none but the given resources."""
    runs = visible_runs(lab, seen).values("pk")
    return with_runs(Job.objects.filter(pk__in=list(ids), run__in=runs))


def find_job(job_id: UUID) -> Job:
    """Return a job with its run and device.

    Raises:
        NotFoundError: There is none.
    """
    row = Job.objects.filter(pk=job_id).select_related("run__lab", "device__host").first()
    if row is None:
        raise NotFoundError(f"no job {job_id}", code="job.not_found")
    return row


def has_suspended_jobs() -> bool:
    """Say whether any job waits for a host that went away."""
    return Job.objects.filter(state=JobState.SUSPENDED.value).exists()


def runs_with_waiting_jobs() -> QuerySet[Run]:
    """Runs with a job that is queued or suspended, oldest first."""
    waiting = Job.objects.filter(state__in=[JobState.QUEUED.value, JobState.SUSPENDED.value])
    return Run.objects.filter(pk__in=waiting.values("run_id")).order_by("created_at")


def last_attempt(job: Job) -> Attempt | None:
    """Return the newest try of a job."""
    return job.attempts.order_by("-number").first()


def jobs_in_doubt(lab: Lab) -> QuerySet[Job]:
    """Jobs whose outcome nobody knows."""
    rows = Job.objects.filter(run__lab=lab, state=JobState.IN_DOUBT.value)
    return with_runs(rows, "run__version__workflow", "device").order_by("state_at")


def jobs_at(host: EdgeHost) -> QuerySet[Job]:
    """Lock and return the jobs that were dispatched to a host and have not ended."""
    states = [state.value for state in AT_EDGE]
    rows = Job.objects.filter(device__host=host, state__in=states).order_by("id")
    return with_runs(rows).select_for_update(of=("self",), no_key=True)


def work_at(host: EdgeHost) -> QuerySet[Job]:
    """Jobs of a host that were sent and have not ended, or that nobody knows about."""
    states = [state.value for state in (*AT_EDGE, JobState.IN_DOUBT)]
    rows = with_runs(Job.objects.filter(device__host=host, state__in=states))
    return rows.order_by("-run__number", "index")


def doubts_at(host: EdgeHost) -> QuerySet[Job]:
    """Jobs of a host whose outcome nobody knows."""
    return Job.objects.filter(device__host=host, state=JobState.IN_DOUBT.value)


def host_events(action_ids: list[UUID]) -> QuerySet[HostEvent]:
    """Events of hosts about some actions, oldest first."""
    return HostEvent.objects.filter(action_id__in=action_ids).order_by("id")


def halts_since(attempt: Attempt, device: Device) -> list[str]:
    """Return what its host told of the start of a try and of halts of its device, since then."""
    started = Q(kind="started", action_id=attempt.pk)
    halted = Q(kind="halted", body__device_id=str(device.id), received_at__gte=attempt.at)
    rows = HostEvent.objects.filter(started | halted, host=attempt.host).order_by("id")
    return list(rows.values_list("kind", flat=True))


def answers_under_way(ids: Iterable[UUID]) -> dict[UUID, tuple[str, datetime]]:
    """Return by action whose answer about it is on its way to the host, and since when."""
    rows = Outbox.objects.filter(action_id__in=list(ids), kind="resolve", settled_at__isnull=True)
    found = list(rows.values_list("action_id", "body__issued_by", "at"))
    names = account_selectors.printed_names({by for _, by, _ in found}) if found else {}
    return {action_id: (names.get(by, by), at) for action_id, by, at in found}


def jobs_at_devices(device_ids: Iterable[UUID]) -> dict[UUID, Job]:
    """Return the job each device has now, from dispatch to its end."""
    states = [state.value for state in (*AT_EDGE, JobState.IN_DOUBT)]
    rows = Job.objects.filter(device_id__in=list(device_ids), state__in=states)
    return {row.device_id: row for row in with_runs(rows).order_by("-state_at")}
