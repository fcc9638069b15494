"""Reads of calibrations."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from datetime import datetime
from typing import Any, NamedTuple
from uuid import UUID

import msgspec
from django.contrib.postgres.fields import ArrayField
from django.db.models import F, QuerySet, UUIDField

from labweb.calibration.models import Calibration as Calibration
from labweb.common.database.prepared_queries import Given, IsAnyOf, Prepared
from labweb.common.render import iso
from labweb.domain.calibration import calibration_validity, correction
from labweb.domain.calibration.calibration_order import Reference
from labweb.domain.calibration.calibration_result import CalibrationOutcome
from labweb.domain.calibration.correction import (
    CalibrationQuantity,
    CalibrationStanding,
    Correction,
)
from labweb.domain.calibration.correction_at_dispatch import check_sending
from labweb.domain.errors import Finding, NotFoundError, StateError
from labweb.domain.runs.states.job_states import JobState, RunState
from labweb.enrollment.selectors import Device

_COUNTED = [Calibration.State.ACCEPTED, Calibration.State.WITHDRAWN]
_PEOPLE = ("made_by", "decided_by", "withdrawn_by", "run")


def fingerprint_of(device: Device) -> dict[str, Any]:
    """Return what makes a device the one that was calibrated."""
    return {
        "driver": device.driver.digest,
        "config": device.config,
        "transport": device.transport,
        "admitted_at": iso(device.admitted_at),
    }


def history_of(device: Device) -> QuerySet[Calibration]:
    """Every calibration of a device, the newest first."""
    rows = Calibration.objects.filter(device=device).select_related(*_PEOPLE)
    return rows.order_by("quantity", "-number")


def find_calibration(calibration_id: UUID) -> Calibration:
    """Return a calibration with its device.

    Raises:
        NotFoundError: There is none.
    """
    rows = Calibration.objects.select_related("device__driver", *_PEOPLE)
    row = rows.filter(pk=calibration_id).first()
    if row is None:
        raise NotFoundError(f"no calibration {calibration_id}", code="calibration.not_found")
    return row


def references_of(row: Calibration) -> list[Reference]:
    """Return every standard that a device was compared with."""
    if "buffers" in row.order:
        return [msgspec.convert(one["reference"], Reference) for one in row.order["buffers"]]
    return [msgspec.convert(row.order["reference"], Reference)]


def calibration_for_update(calibration_id: UUID) -> Calibration:
    """Return a calibration, locked; raises as `find_calibration`."""
    find_calibration(calibration_id)
    rows = Calibration.objects.select_for_update(of=("self",), no_key=True)
    return rows.select_related("device__driver").get(pk=calibration_id)


def measured_in(run_ids: QuerySet[Any]) -> QuerySet[Calibration]:
    """Calibrations that were measured in runs."""
    return Calibration.objects.filter(run__in=run_ids)


def runs_that_measured(ids: Collection[UUID]) -> dict[UUID, UUID]:
    """Return the run of each calibration, by its id."""
    return dict(Calibration.objects.filter(pk__in=ids).values_list("pk", "run_id"))


def ended_calibrations() -> QuerySet[Calibration]:
    """Calibrations under way whose run has ended."""
    ended = [RunState.COMPLETE.value, RunState.ABORTED.value]
    return Calibration.objects.filter(state=Calibration.State.MEASURING, run__state__in=ended)


class CompletedJob(NamedTuple):
    """What a job of the run that measures has told, once it was complete."""

    step_id: str
    action: str
    args: dict[str, Any]
    evidence: dict[str, Any]
    ended_at: datetime | None


def completed_jobs(row: Calibration, actions: Collection[str] = ()) -> list[CompletedJob]:
    """Return the complete jobs of a calibration's run in their order: of some actions, or all."""
    jobs = row.run.jobs.filter(state=JobState.COMPLETE.value)
    if actions:
        jobs = jobs.filter(action__in=actions)
    return [
        CompletedJob(job.step_id, job.action, job.args, job.evidence, job.ended_at)
        for job in jobs.order_by("index")
    ]


def accepted_of(devices: Collection[Device]) -> dict[UUID, list[Calibration]]:
    """Return by device the newest calibration of each quantity that was ever accepted; a query."""
    found: dict[UUID, list[Calibration]] = {}
    for row in _NEWEST.rows(ids=[device.id for device in devices]):
        found.setdefault(row.device_id, []).append(row)
    return found


_NEWEST = Prepared(
    lambda: (
        Calibration.objects.filter(
            IsAnyOf(F("device_id"), Given("ids", ArrayField(UUIDField()))), state__in=_COUNTED
        )
        .order_by("device_id", "quantity", "-number")
        .distinct("device_id", "quantity")
        .select_related(*_PEOPLE)
    )
)


OF_LAB = Prepared(
    lambda: (
        Calibration.objects.filter(device__lab_id=Given("lab", UUIDField()), state__in=_COUNTED)
        .order_by("device_id", "quantity", "-number")
        .distinct("device_id", "quantity")
    )
)
"""The newest calibration of each quantity of each device of a lab that was ever accepted."""


def findings_of_sending(device: Device, corrected: Any, *, at: datetime) -> list[Finding]:  # noqa: ANN401 - JSON of a job
    """List what keeps a job of a device from going with the numbers that calibrations gave it.

    Effect:
        The calibrations stay locked until the command is on disk: who withdraws one waits, and
        then recalls the job.
    """
    corrections = msgspec.convert(corrected, list[Correction])
    rows = Calibration.objects.filter(
        pk__in=[one.calibration_id for one in corrections]
    ).select_for_update(no_key=True)
    known = {row.id: _to_domain(row, device, at) for row in rows}
    newest = {row.quantity: row.number for row in accepted_of([device]).get(device.id, [])}
    return check_sending(device.name, corrections, known, newest)


def standing_of(
    row: Calibration, device: Device, *, at: datetime
) -> tuple[CalibrationStanding, tuple[str, ...]]:
    """Return whether an accepted calibration still holds of the device, and every reason."""
    if row.expires_at is None:
        raise StateError("only what was accepted holds", code="calibration.not_decided")
    return calibration_validity.standing_of(
        expires_at=row.expires_at,
        is_withdrawn=row.state == Calibration.State.WITHDRAWN,
        was=row.fingerprint,
        is_now=fingerprint_of(device),
        at=at,
    )


def calibrations_of(
    devices: Collection[Device], rows: Iterable[Calibration], *, at: datetime
) -> dict[UUID, tuple[correction.AcceptedCalibration, ...]]:
    """Return what planning needs to know of the devices' calibrations, which were read so."""
    known = {device.id: device for device in devices}
    found: dict[UUID, tuple[correction.AcceptedCalibration, ...]] = {}
    for row in rows:
        if row.device_id in known:
            one = _to_domain(row, known[row.device_id], at)
            found[row.device_id] = (*found.get(row.device_id, ()), one)
    return found


def _to_domain(row: Calibration, device: Device, at: datetime) -> correction.AcceptedCalibration:
    result = msgspec.convert(row.result, CalibrationOutcome)
    found, reasons = standing_of(row, device, at=at)
    return correction.AcceptedCalibration(
        id=row.id,
        quantity=CalibrationQuantity(row.quantity),
        number=row.number,
        gain=result.gain,
        offset=result.offset,
        levels=result.certified(),
        expires_at=row.expires_at,
        standing=found,
        reasons=reasons,
    )
