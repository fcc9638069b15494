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
from labweb.runs.models import Run
from labweb.runs.selectors.jobs import jobs_in_doubt
from labweb.runs.selectors.run_needs import LIVE, runs_that_wait
from labweb.runs.selectors.scheduling import (
    owed_halts,
)
from labweb.runs.selectors.unread_devices import silent_devices


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
