"""What completed actions of live runs have left standing, and which devices nobody reads it of."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, NamedTuple
from uuid import UUID

from django.db.models import Max, QuerySet

from labweb.common.clock import now
from labweb.domain.enrollment.setpoint_readback import kept_by, unread_since_s
from labweb.domain.runs.halts.halted_setpoints import Done, still_standing
from labweb.domain.runs.states.job_states import JobState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.runs.models import Job, Run
from labweb.runs.selectors.jobs_without_plans import with_runs
from labweb.runs.selectors.run_needs import LIVE
from labweb.telemetry import selectors as telemetry_selectors

_ACTING = {JobState.RUNNING.value, JobState.COMPLETING.value}


@dataclass(frozen=True, slots=True, kw_only=True)
class Silent:
    """A device on which something of a live run stands, and of which it is not read."""

    device: Device
    run: Run
    jobs: tuple[Job, ...]
    """Those that set it, in the order in which they were sent."""

    since_at: datetime


def standing_jobs(rows: QuerySet[Job]) -> dict[UUID, list[Job]]:
    """Return by device which completed jobs a halt of it takes something away of.

    A run has hundreds of completed jobs, and few of them stand: only those are read whole. One
    query, and a second one where anything stands.

    Args:
        rows: Jobs of live runs. What a halt or a loss has taken away already is left out.
    """
    complete = rows.filter(state=JobState.COMPLETE.value)
    in_order = complete.annotate(last=Max("attempts__dseq")).order_by("last", "pk")
    done: dict[UUID, list[_Ended]] = {}
    for row in in_order.values_list("pk", "device_id", "action", "args", "halted_by"):
        ended = _Ended(*row)
        done.setdefault(ended.device_id, []).append(ended)
    ids = {device_id: _standing(ended) for device_id, ended in done.items()}
    jobs = rows.in_bulk([one for found in ids.values() for one in found])
    return {device_id: [jobs[one] for one in found] for device_id, found in ids.items() if found}


class _Ended(NamedTuple):
    job_id: UUID
    device_id: UUID
    action: str
    args: dict[str, Any]
    halted_by: str


def _standing(ended: list[_Ended]) -> list[UUID]:
    told = (Done(index=at, action=one.action, args=one.args) for at, one in enumerate(ended))
    return [ended[at].job_id for at in still_standing(told) if not ended[at].halted_by]


def silent_devices() -> list[Silent]:
    """Return the devices of live runs of which what stands is not read any more.

    A device at which an action acts is left out: the action reads it back itself, and ends when
    it cannot. So are those of an aborted run, which are halted. Four queries at most.
    """
    live = Job.objects.filter(run__state__in=LIVE)
    rows = with_runs(live, "device__host", "device__lab", "run__version__workflow")
    standing = standing_jobs(rows.filter(run__is_given_up=False))
    if not standing:
        return []
    acting = set(
        Job.objects.filter(device__in=list(standing), state__in=_ACTING).values_list(
            "device_id", flat=True
        )
    )
    idle = {one: jobs for one, jobs in standing.items() if one not in acting}
    read = telemetry_selectors.latest(idle)
    found = []
    for device_id, jobs in idle.items():
        times = {status: at for status, (at, _) in read.get(device_id, {}).items()}
        for run_id in dict.fromkeys(job.run_id for job in jobs):
            one = _silent([job for job in jobs if job.run_id == run_id], times)
            if one is not None:
                found.append(one)
    return sorted(found, key=lambda one: (one.since_at, one.device.name))


def _silent(jobs: list[Job], read_s: dict[str, float]) -> Silent | None:
    device = jobs[0].device
    spec = enrollment_selectors.specs_of([device])[device.id]
    statuses = [one.name for one in spec.statuses]
    kept = {job.id: kept_by(job.action, job.args, statuses) for job in jobs}
    mine = [job for job in jobs if kept[job.id]]
    since_s = unread_since_s(
        [one for job in mine for one in kept[job.id]],
        read_s,
        max((job.ended_at.timestamp() for job in mine if job.ended_at is not None), default=0.0),
        now().timestamp(),
        device.host.pace,
    )
    if since_s is None:
        return None
    since_at = datetime.fromtimestamp(since_s, UTC)
    return Silent(device=device, run=mine[0].run, jobs=tuple(mine), since_at=since_at)
