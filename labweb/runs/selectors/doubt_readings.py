"""What a device's readings say of a job that is or was in doubt: from before, and since."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

import msgspec
from django.db.models import F

from labweb.crutd import selectors as crutd_selectors
from labweb.crutd.selectors import Ticket
from labweb.domain.calibration.correction import CalibrationQuantity, Correction
from labweb.domain.runs.after_failure.doubt_by_readings import (
    DIRECTIONS,
    PLUNGER,
    Plunger,
    PlungerMeasured,
    measure,
)
from labweb.domain.runs.halts.halted_setpoints import INTERRUPTED, MAY_MOVE
from labweb.runs.models import Attempt, HostEvent, Job, Run
from labweb.telemetry import selectors as telemetry_selectors

STANDS_S = 1.0
"""A plunger that told the same for so long stands."""

UNREAD = "unread"
"""Where the evidence of a job keeps which tries were answered for before its device was read."""

CONTRADICTED_BY = "contradicted_by"
"""Where it keeps the tickets about answers that were read to be otherwise."""

_MOST_LATER = 500
"""Actions of its host after which nobody waits for a reading any more."""


def asked_nl(job: Job) -> int:
    """Return how much liquid a job was to move; 0: it moves none."""
    is_liquid = job.operation.get("op") == "transfer_liquid"
    return int(job.operation["amount_nl"]) if is_liquid else 0


def has_older_doubt(attempt: Attempt) -> bool:
    """Tell whether a try before this one was in doubt."""
    others = Attempt.objects.filter(job_id=attempt.job_id, number__lt=attempt.number)
    return others.filter(transaction__events__state="quarantined").exists()


def unread_answers() -> list[Attempt]:
    """Return the tries that a person answered for before their device was read; one query.

    Of each host those among its last actions: what a plunger tells is soon about another one.
    """
    recent = Attempt.objects.filter(dseq__gt=F("host__last_dseq") - _MOST_LATER)
    rows = recent.filter(job__evidence__has_key=UNREAD).order_by("pk")
    found = rows.select_related("host", "job__device", "job__run")
    return [one for one in found if str(one.pk) in one.job.evidence[UNREAD]]


def contradicted(run: Run, jobs: Iterable[Job]) -> list[Ticket]:
    """Return what is open of answers in a run that its devices contradict; one query, or none."""
    known = [one for job in jobs for one in job.evidence.get(CONTRADICTED_BY, ())]
    if not known:
        return []
    return list(crutd_selectors.open_tickets(run.lab).filter(pk__in=known))


def measured_of(job: Job, attempt: Attempt) -> PlungerMeasured | None:
    """Return what the plunger says of a job that is or was in doubt; None: none moves with it.

    What it tells once its device has begun something else says nothing of this job.
    """
    tolerance_ul = _tolerance_ul(job)
    if job.action not in DIRECTIONS or not asked_nl(job) or tolerance_ul is None:
        return None
    after_ul, why_not = _after(job, attempt, tolerance_ul)
    corrections = msgspec.convert(job.corrections, list[Correction])
    return measure(
        Plunger(
            action=job.action,
            asked_nl=asked_nl(job),
            before_ul=_before(job, attempt),
            after_ul=after_ul,
            why_no_after=why_not,
            tolerance_ul=tolerance_ul,
            correction=next(
                (c for c in corrections if c.quantity is CalibrationQuantity.VOLUME), None
            ),
        )
    )


def _tolerance_ul(job: Job) -> float | None:
    """Return how well the plan says that the plunger is known; None: it has no say there."""
    for condition in (*job.post, *job.pre):
        if condition["status"] == PLUNGER and condition["device_id"] == str(job.device_id):
            return float(condition.get("tolerance") or 0.0)
    return None


def _before(job: Job, attempt: Attempt) -> float | None:
    """Return what was read just before the first byte, as the host wrote it down with the start."""
    rows = HostEvent.objects.filter(action_id=attempt.id, kind="started").order_by("-id")
    started = rows.first()
    return None if started is None else _read_with(started, job.device_id)


def _read_with(started: HostEvent, device_id: UUID) -> float | None:
    """Return where a plunger stood just before an action began, as its host wrote it down."""
    readings = (started.body.get("prestate") or {}).get("readings") or []
    for device, status, value in readings:
        if (device, status) == (str(device_id), PLUNGER):
            return _volume(value)
    return None


def _after(job: Job, attempt: Attempt, tolerance_ul: float) -> tuple[float | None, str]:
    """Return where the plunger stands since the doubt began, or why that is not known."""
    name = job.device.name
    if str(job.device_id) in attempt.host.heartbeat.get("halts_owed", ()):
        return None, f"{name} has still to be halted, once it answers"
    doubts = HostEvent.objects.filter(action_id=attempt.id, kind="in_doubt").order_by("-id")
    since_s = doubts.values_list("at_s", flat=True).first()
    following = _following(job, attempt)
    until_s = None if following is None else following.at_s
    told = [] if since_s is None else _told_within(job.device_id, since_s, until_s)
    if told:
        last_s, last_ul = told[-1]
        late = [ul for at_s, ul in told if at_s >= last_s - STANDS_S]
        if max(late) - min(late) > tolerance_ul:
            return None, f"the plunger of {name} still moves"
        return last_ul, ""
    evidence = (job.evidence.get("report") or {}).get("evidence") or {}
    if job.code == INTERRUPTED and MAY_MOVE not in job.message:
        value = _volume(evidence.get(PLUNGER))
        if value is not None:
            return value, ""
    value = None if following is None else _read_with(following, job.device_id)
    return value, "" if value is not None else f"{name} has not told it since"


def _following(job: Job, attempt: Attempt) -> HostEvent | None:
    """Return the start of what its device did next; None: it has begun nothing since."""
    later = Attempt.objects.filter(
        job__device_id=job.device_id, host_id=attempt.host_id, dseq__gt=attempt.dseq
    )
    started = HostEvent.objects.filter(action_id__in=later.values("pk"), kind="started")
    return started.order_by("id").first()


def _told_within(
    device_id: UUID, since_s: float, until_s: float | None
) -> list[tuple[float, float]]:
    rows = telemetry_selectors.newest_samples(device_id, PLUNGER, since_s, until_s)
    found = [(at_s, _volume(value)) for at_s, value in rows]
    return [(at_s, value) for at_s, value in reversed(found) if value is not None]


def _volume(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value)
