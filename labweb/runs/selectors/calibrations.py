"""Reads of calibrations."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from datetime import datetime
from typing import Any
from uuid import UUID

import msgspec
from django.contrib.postgres.fields import ArrayField
from django.db.models import F, QuerySet, UUIDField

from labweb.common.database.prepared_queries import Given, IsAnyOf, Prepared
from labweb.common.render import iso
from labweb.domain.calibration import model, standing
from labweb.domain.calibration.judge import Result
from labweb.domain.calibration.model import Correction, Quantity, Standing
from labweb.domain.calibration.order import Reference
from labweb.domain.calibration.sending import check_sending
from labweb.domain.errors import Finding, NotFoundError, StateError
from labweb.domain.runs.job import RunState
from labweb.enrollment.selectors import Device
from labweb.runs.models import Calibration, Job

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


def findings_of_sending(jobs: Iterable[Job], *, at: datetime) -> list[Finding]:
    """List what keeps jobs from going with the numbers that calibrations have given them.

    Jobs without such numbers ask nothing of the database.
    """
    found: list[Finding] = []
    for job in jobs:
        if job.corrections:
            found += _of_sending(job, msgspec.convert(job.corrections, list[Correction]), at)
    return found


def _of_sending(job: Job, corrections: list[Correction], at: datetime) -> list[Finding]:
    # Locked until the command is on disk: who withdraws one waits, and then recalls the job.
    rows = Calibration.objects.filter(
        pk__in=[one.calibration_id for one in corrections]
    ).select_for_update(no_key=True)
    known = {row.id: _to_domain(row, job.device, at) for row in rows}
    newest = {row.quantity: row.number for row in accepted_of([job.device]).get(job.device_id, [])}
    return check_sending(job.device.name, corrections, known, newest)


def standing_of(
    row: Calibration, device: Device, *, at: datetime
) -> tuple[Standing, tuple[str, ...]]:
    """Return whether an accepted calibration still holds of the device, and every reason."""
    if row.expires_at is None:
        raise StateError("only what was accepted holds", code="calibration.not_decided")
    return standing.standing_of(
        expires_at=row.expires_at,
        is_withdrawn=row.state == Calibration.State.WITHDRAWN,
        was=row.fingerprint,
        is_now=fingerprint_of(device),
        at=at,
    )


def calibrations_of(
    devices: Collection[Device], rows: Iterable[Calibration], *, at: datetime
) -> dict[UUID, tuple[model.Calibration, ...]]:
    """Return what planning needs to know of the devices' calibrations, which were read so."""
    known = {device.id: device for device in devices}
    found: dict[UUID, tuple[model.Calibration, ...]] = {}
    for row in rows:
        if row.device_id in known:
            one = _to_domain(row, known[row.device_id], at)
            found[row.device_id] = (*found.get(row.device_id, ()), one)
    return found


def _to_domain(row: Calibration, device: Device, at: datetime) -> model.Calibration:
    result = msgspec.convert(row.result, Result)
    found, reasons = standing_of(row, device, at=at)
    return model.Calibration(
        id=row.id,
        quantity=Quantity(row.quantity),
        number=row.number,
        gain=result.gain,
        offset=result.offset,
        levels=result.certified(),
        expires_at=row.expires_at,
        standing=found,
        reasons=reasons,
    )
