"""What the top of every page says of the lab: its stop, its hosts, its disks."""

from __future__ import annotations

from labweb.approvals import selectors as approval_selectors
from labweb.common import disk
from labweb.crutd import selectors as crutd_selectors
from labweb.domain.disk_space import DiskRoomLevel
from labweb.domain.graph.lab_file.lab_model import LabMode
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import EdgeHost
from labweb.resources.selectors import Lab
from labweb.runs.answers.lab import LabCounts, LabStop, LabSummary, StopHost
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
from labweb.runs.selectors.jobs import jobs_in_doubt
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


def lab_summary(lab: Lab) -> LabSummary:
    """Return the lab as every page shows it."""
    live = Run.objects.filter(lab=lab, state__in=LIVE)
    doubts = jobs_in_doubt(lab).count()
    alone = runs_that_wait(live).count()  # a run with a job in doubt is one thing, not two
    tickets = crutd_selectors.open_tickets(lab).count()
    unknown = len(crutd_selectors.given_up(lab)) + len(owed_halts(lab.pk))
    waiting = approval_selectors.requests_of(lab).filter(state="open", driver_id=None).count()
    brought = approval_selectors.open_about_drivers(lab).count()
    known = list(enrollment_selectors.hosts_of(lab))
    return LabSummary(
        id=lab.id,
        key=lab.key,
        name=lab.name,
        mode=LabMode(lab.mode),
        time_zone=lab.time_zone,
        speed=max((host.pace for host in known), default=1.0),
        stop=_stop(lab, known),
        counts=LabCounts(
            runs_live=live.count(),
            approvals_open=waiting,
            drivers_open=brought,
            needs_you=doubts
            + alone
            + waiting
            + brought
            + unknown
            + tickets
            + lab.is_stopped
            + len(silent_devices())
            + _short_disks_count(known),
        ),
    )


def _short_disks_count(known: list[EdgeHost]) -> int:
    told = [disk.server_disk(), *(one for _, one in enrollment_selectors.disks_of(known))]
    return sum(one is not None and one.level(disk.floors()) is not DiskRoomLevel.OK for one in told)


def _stop(lab: Lab, known: list[EdgeHost]) -> LabStop:
    hosts = [
        StopHost(
            id=host.id,
            name=host.name,
            state=SessionState(host.state),
            acknowledged_at=host.stop_acknowledged_at
            if host.stop_acknowledged == lab.stop_id
            else None,
            after_s=_after_s(lab, host),
        )
        for host in known
    ]
    return LabStop(
        is_stopped=lab.is_stopped,
        stop_id=lab.stop_id,
        stopped_at=lab.stopped_at,
        stopped_by=None if lab.stopped_by is None else lab.stopped_by.printed_name,
        hosts=hosts if lab.is_stopped else [],
    )


def _after_s(lab: Lab, host: EdgeHost) -> float | None:
    """Return how long a host took to acknowledge the stop; None: it has not, or nobody knows."""
    at, since = host.stop_acknowledged_at, lab.stopped_at
    if at is None or since is None or host.stop_acknowledged != lab.stop_id:
        return None
    took_s = (at - since).total_seconds()
    return round(took_s, 3) if took_s >= 0 else None
