"""What the readings of a device say of a job in doubt: those from before, and those since."""

from __future__ import annotations

from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.calibration.model import Correction, Quantity
from labweb.domain.runs.doubting import DIRECTIONS, PLUNGER, Measured, Plunger, measure
from labweb.domain.runs.halting import INTERRUPTED, MAY_MOVE
from labweb.runs.models import Attempt, HostEvent, Job
from labweb.telemetry import selectors as telemetry_selectors

STANDS_S = 1.0
"""A plunger that told the same for so long stands."""


def asked_nl(job: Job) -> int:
    """Return how much liquid a job was to move; 0: it moves none."""
    is_liquid = job.operation.get("op") == "transfer_liquid"
    return int(job.operation["amount_nl"]) if is_liquid else 0


def has_older_doubt(attempt: Attempt) -> bool:
    """Tell whether a try before this one was in doubt."""
    others = Attempt.objects.filter(job_id=attempt.job_id, number__lt=attempt.number)
    return others.filter(transaction__events__state="quarantined").exists()


def measured_of(job: Job, attempt: Attempt) -> Measured | None:
    """Return what the plunger says of a job in doubt; None: no plunger moves with it."""
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
            correction=next((c for c in corrections if c.quantity is Quantity.VOLUME), None),
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
    body: dict[str, Any] = rows.values_list("body", flat=True).first() or {}
    readings = (body.get("prestate") or {}).get("readings") or []
    for device_id, status, value in readings:
        if (device_id, status) == (str(job.device_id), PLUNGER):
            return _volume(value)
    return None


def _after(job: Job, attempt: Attempt, tolerance_ul: float) -> tuple[float | None, str]:
    """Return where the plunger stands since the doubt began, or why that is not known."""
    name = job.device.name
    if str(job.device_id) in attempt.host.heartbeat.get("halts_owed", ()):
        return None, f"{name} has still to be halted, once it answers"
    doubts = HostEvent.objects.filter(action_id=attempt.id, kind="in_doubt").order_by("-id")
    since_s = doubts.values_list("at_s", flat=True).first()
    told = [] if since_s is None else _told_since(job.device_id, since_s)
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
    return None, f"{name} has not told it since"


def _told_since(device_id: UUID, since_s: float) -> list[tuple[float, float]]:
    rows = telemetry_selectors.newest_samples(device_id, PLUNGER, since_s)
    found = [(at_s, _volume(value)) for at_s, value in rows]
    return [(at_s, value) for at_s, value in reversed(found) if value is not None]


def _volume(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value)
