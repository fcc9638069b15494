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
from labweb.runs.models import Attempt as Attempt
from labweb.runs.models import Custody as Custody
from labweb.runs.models import DeviceHalt as DeviceHalt
from labweb.runs.models import HostEvent as HostEvent
from labweb.runs.models import Job as Job
from labweb.runs.models import Outbox as Outbox
from labweb.runs.models import Run as Run
from labweb.runs.selectors.custody import find_move as find_move
from labweb.runs.selectors.custody import hands_between as hands_between
from labweb.runs.selectors.custody import hosts_between as hosts_between
from labweb.runs.selectors.custody import hosts_of_carry as hosts_of_carry
from labweb.runs.selectors.custody import is_told as is_told
from labweb.runs.selectors.custody import moves_of as moves_of
from labweb.runs.selectors.custody import moves_of_run as moves_of_run
from labweb.runs.selectors.custody import open_move_of as open_move_of
from labweb.runs.selectors.custody import owner_of as owner_of
from labweb.runs.selectors.doubt_readings import CONTRADICTED_BY as CONTRADICTED_BY
from labweb.runs.selectors.doubt_readings import UNREAD as UNREAD
from labweb.runs.selectors.doubt_readings import asked_nl as asked_nl
from labweb.runs.selectors.doubt_readings import contradicted as contradicted
from labweb.runs.selectors.doubt_readings import has_older_doubt as has_older_doubt
from labweb.runs.selectors.doubt_readings import measured_of as measured_of
from labweb.runs.selectors.doubt_readings import unread_answers as unread_answers
from labweb.runs.selectors.jobs_without_plans import with_runs as with_runs
from labweb.runs.selectors.recovery import accepted_departures as accepted_departures
from labweb.runs.selectors.recovery import choices_after as choices_after
from labweb.runs.selectors.recovery import ended_job as ended_job
from labweb.runs.selectors.recovery import evidence_left as evidence_left
from labweb.runs.selectors.recovery import halted_jobs as halted_jobs
from labweb.runs.selectors.recovery import has_paused as has_paused
from labweb.runs.selectors.recovery import is_discarded as is_discarded
from labweb.runs.selectors.recovery import is_unanswered as is_unanswered
from labweb.runs.selectors.recovery import later_jobs as later_jobs
from labweb.runs.selectors.recovery import moved_nl as moved_nl
from labweb.runs.selectors.recovery import partner_job as partner_job
from labweb.runs.selectors.recovery import recovery_choices as recovery_choices
from labweb.runs.selectors.recovery import recovery_of as recovery_of
from labweb.runs.selectors.recovery import waits_of as waits_of
from labweb.runs.selectors.run_needs import LIVE as LIVE
from labweb.runs.selectors.run_needs import jobs_that_ask as jobs_that_ask
from labweb.runs.selectors.run_needs import runs_that_need as runs_that_need
from labweb.runs.selectors.run_needs import runs_that_wait as runs_that_wait
from labweb.runs.selectors.runs import visible_runs
from labweb.runs.selectors.scheduling import HALTING_AT as HALTING_AT
from labweb.runs.selectors.scheduling import JOB_TO_LOCK as JOB_TO_LOCK
from labweb.runs.selectors.scheduling import RUN_TO_LOCK as RUN_TO_LOCK
from labweb.runs.selectors.scheduling import asking as asking
from labweb.runs.selectors.scheduling import asking_number as asking_number
from labweb.runs.selectors.scheduling import asking_run_number as asking_run_number
from labweb.runs.selectors.scheduling import attempt_for_update as attempt_for_update
from labweb.runs.selectors.scheduling import due_outbox as due_outbox
from labweb.runs.selectors.scheduling import halts_of as halts_of
from labweb.runs.selectors.scheduling import hold_run_of as hold_run_of
from labweb.runs.selectors.scheduling import is_halting as is_halting
from labweb.runs.selectors.scheduling import job_for_update as job_for_update
from labweb.runs.selectors.scheduling import last_halt as last_halt
from labweb.runs.selectors.scheduling import next_number as next_number
from labweb.runs.selectors.scheduling import open_halts as open_halts
from labweb.runs.selectors.scheduling import owed_halts as owed_halts
from labweb.runs.selectors.scheduling import run_for_update as run_for_update
from labweb.runs.selectors.scheduling import to_schedule as to_schedule
from labweb.runs.selectors.scheduling import views as views
from labweb.runs.selectors.stated_lots import to_state as to_state
from labweb.runs.selectors.unread_devices import silent_devices as silent_devices
from labweb.runs.selectors.unread_devices import standing_jobs as standing_jobs


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
