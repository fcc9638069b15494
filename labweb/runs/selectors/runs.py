"""Reads of runs."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import NamedTuple
from uuid import UUID

from django.db.models import CharField, QuerySet, Value
from django.db.models.functions import Cast, Concat

from labweb.domain.errors import NotFoundError
from labweb.domain.runs.after_failure.recovery_choices import RunWaitCause
from labweb.domain.runs.states.job_states import RunState
from labweb.resources import selectors as resource_selectors
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


def runs_of(lab: Lab) -> QuerySet[Run]:
    """Runs of a lab, newest first."""
    return Run.objects.filter(lab=lab).select_related("version__workflow", "created_by", "lab")


def visible_runs(lab: Lab, seen: Collection[UUID]) -> QuerySet[Run]:
    """Runs that use none but the given resources, newest first; all to who sees the root."""
    if resource_selectors.root_of(lab).id in seen:
        return runs_of(lab)
    shown = [str(node) for node in seen]
    hidden = Job.objects.filter(run__lab=lab).exclude(locks__contained_by=shown)
    return runs_of(lab).exclude(pk__in=hidden.values("run_id"))


def runs_named(rows: QuerySet[Run], text: str) -> QuerySet[Run]:
    """Return those of the runs whose name has a text, `Run #12 Move water`; in any case."""
    number = Cast("number", CharField())
    name = Concat(Value("Run #"), number, Value(" "), "version__workflow__name")
    return rows.alias(called=name).filter(called__icontains=text)


def waiting_runs(version_id: UUID) -> list[Run]:
    """Runs of a version that have not begun, newest first."""
    over = [RunState.COMPLETE.value, RunState.ABORTED.value]
    rows = Run.objects.filter(version_id=version_id, started_at=None).exclude(state__in=over)
    return list(rows.order_by("-number"))


def find_run(run_id: UUID) -> Run:
    """Return a run.

    Raises:
        NotFoundError: There is none.
    """
    row = (
        Run.objects.filter(pk=run_id)
        .select_related("version__workflow", "created_by", "lab")
        .first()
    )
    if row is None:
        raise NotFoundError(f"no run {run_id}", code="run.not_found")
    return row


def named_run(text: str) -> Run:
    """Return a run by its id, or by its number, with `#` before it or not.

    Raises:
        NotFoundError: There is none, or the text is neither.
    """
    number = text.removeprefix("#")
    if number.isascii() and number.isdigit() and len(number) < 10:
        row = runs_of(resource_selectors.the_lab()).filter(number=int(number)).first()
        if row is None:
            raise NotFoundError(f"there is no run #{number}", code="run.not_found")
        return row
    try:
        return find_run(UUID(text))
    except ValueError as error:
        what = f"{text!r} is neither the id nor the number of a run"
        raise NotFoundError(what, code="run.not_found") from error


def runs_by_id(ids: Iterable[UUID]) -> dict[UUID, Run]:
    """Return runs by id, with workflow and lab."""
    rows = Run.objects.filter(pk__in=list(ids)).select_related("version__workflow", "lab")
    return {row.id: row for row in rows}


class LastRun(NamedTuple):
    """The newest run of a workflow."""

    run: Run
    waits_for: RunWaitCause | None
    """What a person has to say before it can go on."""


def last_runs(lab: Lab) -> dict[UUID, LastRun]:
    """Return the newest run of each workflow, and what it waits for."""
    rows = list(
        Run.objects.filter(lab=lab)
        .select_related("version")
        .order_by("version__workflow_id", "-number")
        .distinct("version__workflow_id")
    )
    ended = {RunState.COMPLETE.value, RunState.ABORTED.value}
    waits = waits_of(row.id for row in rows if row.state not in ended)
    return {row.version.workflow_id: LastRun(row, waits.get(row.id)) for row in rows}
