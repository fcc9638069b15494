"""REST of calibrations: what a device's numbers are worth, by whom, and until when."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.calibration import selectors
from labweb.calibration.answers import (
    CalibratedQuantity,
    CalibrationChange,
    CalibrationDetail,
    CalibrationPoint,
    CalibrationResult,
    CalibrationRights,
    CalibrationRun,
    CalibrationsOfDevice,
    CalibrationState,
    StatedAccuracy,
)
from labweb.calibration.models import Calibration
from labweb.calibration.services import calibrations
from labweb.calibration.services.calibration_runs import calibration_runs
from labweb.common.answers import NamedRef
from labweb.common.clock import now
from labweb.common.lists import HISTORY
from labweb.common.requests import body
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.calibration.calibration_order import (
    Order,
    PhOrder,
    TemperatureOrder,
    VolumeOrder,
)
from labweb.domain.calibration.calibration_result import CalibrationOutcome
from labweb.domain.calibration.correction import (
    IS_RELATIVE,
    SYMBOLS,
    CalibrationQuantity,
    CalibrationStanding,
)
from labweb.domain.enrollment.driver_spec import DriverSpec, ParameterSpec
from labweb.domain.errors import Finding, NotFoundError
from labweb.domain.runs.states.job_states import RunState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.resources import selectors as resource_selectors

_MEASURED = (CalibrationQuantity.VOLUME, CalibrationQuantity.PH, CalibrationQuantity.TEMPERATURE)
"""Quantities that a workflow measures."""


class CalibrationDecision(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a decision."""

    is_accepted: bool
    comment: Annotated[str, msgspec.Meta(max_length=10_000)] = ""


class CalibrationWithdrawal(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a withdrawal."""

    reason: Annotated[str, msgspec.Meta(max_length=10_000)]


class DeviceCalibrations(Endpoint):
    """Calibrations of one device."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": VolumeOrder}
    statuses: ClassVar = {"post": 201}
    queries = HISTORY.parameters

    def get(self, request: Request, calibrated_id: UUID) -> CalibrationsOfDevice:
        """List what can be calibrated of it, what is in force, and every version, newest first."""
        user = user_of(request)
        device = enrollment_selectors.visible_device(calibrated_id, user)
        rows = selectors.history_of(device)
        page, following = HISTORY.of_rows(request, rows, "-made_at", "-id")
        return CalibrationsOfDevice(quantities=_quantities(device, page, user), next=following)

    def post(self, request: Request, calibrated_id: UUID) -> CalibrationDetail:
        """Start the run that calibrates it (412 with everything that speaks against it)."""
        return _begun(calibrated_id, body(request, VolumeOrder), user_of(request))


class PhCalibrations(Endpoint):
    """Calibrations of one probe in buffers."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": PhOrder}
    statuses: ClassVar = {"post": 201}

    def post(self, request: Request, probe_id: UUID) -> CalibrationDetail:
        """Start the run that calibrates it (412 with everything that speaks against it)."""
        return _begun(probe_id, body(request, PhOrder), user_of(request))


class TemperatureCalibrations(Endpoint):
    """Calibrations of one heater or thermostat beside a reference thermometer."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": TemperatureOrder}
    statuses: ClassVar = {"post": 201}

    def post(self, request: Request, heating_id: UUID) -> CalibrationDetail:
        """Start the run that calibrates it (412 with everything that speaks against it)."""
        return _begun(heating_id, body(request, TemperatureOrder), user_of(request))


def _begun(device_id: UUID, order: Order, user: User) -> CalibrationDetail:
    """Begin a calibration with what the user may see, and tell of it."""
    for one in (device_id, order.device_id):
        enrollment_selectors.visible_device(one, user)
    resource_selectors.require_seen(user, order.vessel_ids)
    row = calibrations.begin_calibration(device_id, order, actor=user)
    return calibration_detail(selectors.find_calibration(row.id), user)


class OneCalibration(Endpoint):
    """One calibration."""

    def get(self, request: Request, calibration_id: UUID) -> CalibrationDetail:
        """Return it with its points and its result."""
        user = user_of(request)
        return calibration_detail(_find(calibration_id, user), user)


class DecideCalibration(Endpoint):
    """The decision about a result."""

    signs = frozenset({"post"})
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": CalibrationDecision}

    def post(self, request: Request, calibration_id: UUID) -> CalibrationDetail:
        """Accept or reject a result that somebody else measured."""
        user = user_of(request)
        wanted = body(request, CalibrationDecision)
        _find(calibration_id, user)
        calibrations.decide_calibration(
            calibration_id, actor=user, is_accepted=wanted.is_accepted, comment=wanted.comment
        )
        return calibration_detail(selectors.find_calibration(calibration_id), user)


class WithdrawCalibration(Endpoint):
    """The end of a calibration before its due date."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": CalibrationWithdrawal}

    def post(self, request: Request, calibration_id: UUID) -> CalibrationDetail:
        """Let it be relied on no more, for a reason."""
        user = user_of(request)
        wanted = body(request, CalibrationWithdrawal)
        _find(calibration_id, user)
        calibrations.withdraw_calibration(calibration_id, actor=user, reason=wanted.reason)
        return calibration_detail(selectors.find_calibration(calibration_id), user)


def _find(calibration_id: UUID, user: User) -> Calibration:
    """Return a calibration of a device that the user may see; raises NotFoundError."""
    row = selectors.find_calibration(calibration_id)
    seen = resource_selectors.allowed_ids(user, Permission.VIEW)
    if not enrollment_selectors.is_seen(row.device, seen):
        raise NotFoundError(f"no calibration {calibration_id}", code="calibration.not_found")
    return row


def result_of(row: Calibration, user: User) -> CalibrationChange:
    """Say a result as the queue shows it: what it was before, and what it becomes."""
    quantity = CalibrationQuantity(row.quantity)
    before = selectors.accepted_of([row.device]).get(row.device_id, [])
    was = next((one for one in before if one.quantity == quantity and one.pk != row.pk), None)
    if was is not None:
        was.device = row.device
    return CalibrationChange(
        device=NamedRef(id=row.device_id, name=row.device.name),
        quantity=quantity,
        unit=SYMBOLS[quantity],
        is_relative=IS_RELATIVE[quantity],
        becomes=calibration_detail(row, user),
        was=None if was is None else calibration_detail(was, user),
    )


def _quantities(
    device: Device, history: Iterable[Calibration], user: User
) -> list[CalibratedQuantity]:
    rows: dict[str, list[Calibration]] = {}
    for row in history:
        row.device = device
        rows.setdefault(row.quantity, []).append(row)
    counted = {row.quantity: row for row in selectors.accepted_of([device]).get(device.id, [])}
    marked = {one.quantity: one for one in _marked(enrollment_selectors.spec_of(device))}
    found = []
    for quantity in (one for one in _MEASURED if {one.value} & (marked.keys() | rows.keys())):
        newest = counted.get(quantity.value)
        found.append(
            CalibratedQuantity(
                quantity=quantity,
                unit=SYMBOLS[quantity],
                is_relative=IS_RELATIVE[quantity],
                may_begin=quantity.value in marked,
                stated=_stated(marked.get(quantity.value)),
                newest=None if newest is None else newest.id,
                history=[calibration_detail(one, user) for one in rows.get(quantity.value, [])],
            )
        )
    return found


def _marked(spec: DriverSpec) -> Iterator[ParameterSpec]:
    """Yield every number that can be calibrated: a temperature only where it can be set."""
    for action in spec.actions:
        yield from (one for one in action.parameters if one.accuracy is not None)
    for status in spec.statuses:
        if (
            status.value.accuracy is not None
            and status.value.quantity != CalibrationQuantity.TEMPERATURE
        ):
            yield status.value


def _stated(parameter: ParameterSpec | None) -> StatedAccuracy | None:
    """Return what the maker states; None: nothing."""
    stated = None if parameter is None else parameter.accuracy
    if stated is None or (stated.ratio is None and stated.absolute is None):
        return None
    return StatedAccuracy(ratio=stated.ratio, absolute=stated.absolute)


def _found(kept: object) -> CalibrationResult:
    """Say what a calibration found; one that was kept before a field was, has its default."""
    return CalibrationResult(**msgspec.structs.asdict(msgspec.convert(kept, CalibrationOutcome)))


def calibration_detail(row: Calibration, user: User) -> CalibrationDetail:
    """Say one calibration as a page shows it, with what this person may do."""
    reach = resource_selectors.permissions_of(user)
    may_decide = Permission.DECIDE in reach
    standing: CalibrationStanding | None = None
    reasons: tuple[str, ...] = ()
    if row.expires_at is not None:
        standing, reasons = selectors.standing_of(row, row.device, at=now())
    return CalibrationDetail(
        id=row.id,
        device_id=row.device_id,
        quantity=CalibrationQuantity(row.quantity),
        number=row.number,
        state=msgspec.convert(str(row.state), CalibrationState),
        standing=standing,
        reasons=list(reasons),
        run=CalibrationRun(id=row.run_id, number=row.run.number, state=RunState(row.run.state)),
        references=selectors.references_of(row),
        tolerance=row.order["tolerance"],
        valid_days=row.valid_days,
        points=msgspec.convert(row.points, list[CalibrationPoint]),
        result=None if row.result is None else _found(row.result),
        findings=msgspec.convert(row.findings, list[Finding]),
        made_by=row.made_by.printed_name,
        made_at=row.made_at,
        measured_at=row.measured_at,
        decided_by=None if row.decided_by is None else row.decided_by.printed_name,
        decided_at=row.decided_at,
        comment=row.comment,
        expires_at=row.expires_at,
        withdrawn_by=None if row.withdrawn_by is None else row.withdrawn_by.printed_name,
        withdrawn_at=row.withdrawn_at,
        withdrawn_because=row.withdrawn_because,
        request_id=calibration_runs().request_id_of(row.id)
        if row.state == Calibration.State.AWAITING
        else None,
        can=CalibrationRights(withdraw=may_decide and row.state == Calibration.State.ACCEPTED),
    )
