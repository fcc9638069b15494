"""What the endpoints of calibrations answer with."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal
from uuid import UUID

from msgspec import UNSET, UnsetType

from labweb.common.answers import ApiAnswer, NamedRef
from labweb.domain.calibration.calibration_order import Reference
from labweb.domain.calibration.calibration_result import LevelResult
from labweb.domain.calibration.correction import CalibrationQuantity, CalibrationStanding
from labweb.domain.errors import Finding
from labweb.domain.runs.states.job_states import RunState

CalibrationState = Literal["measuring", "failed", "awaiting", "accepted", "rejected", "withdrawn"]
"""How far a calibration has come."""


class CalibrationRun(ApiAnswer):
    """The run whose readings are the points of a calibration."""

    id: UUID
    number: int
    state: RunState


class CalibrationPoint(ApiAnswer):
    """One comparison of a device with a reference."""

    level: float
    """What was asked of the device, or what the standard is called."""

    indicated: float
    """What the device made of it, in its own numbers."""

    reference: float
    """The true value by the reference, in the quantity's unit."""

    standard: float
    """Standard uncertainty of the reference value."""

    at_s: float
    weighing: dict[str, Any] | UnsetType = UNSET
    """What a balance told, of a volume."""

    reading: dict[str, Any] | UnsetType = UNSET
    """What a probe told, of a pH."""

    comparison: dict[str, Any] | UnsetType = UNSET
    """What the device and the thermometer told, of a temperature."""


class CalibrationResult(ApiAnswer):
    """What a calibration found: `true = offset + gain × device`."""

    quantity: CalibrationQuantity
    gain: float
    offset: float
    gain_expanded: float
    """Expanded uncertainty (k = 2), as every number that is called so."""

    offset_expanded: float
    covariance: float
    levels: list[LevelResult]
    slope_pct: float | None
    """Of an electrode: its slope, as a share of the Nernst slope in percent."""

    offset_mv: float | None
    """Of an electrode: its offset at pH 7."""

    findings: list[Finding]


class CalibrationRights(ApiAnswer):
    """What the caller may do with a calibration."""

    withdraw: bool


class CalibrationDetail(ApiAnswer):
    """One calibration of one quantity of a device."""

    id: UUID
    device_id: UUID
    quantity: CalibrationQuantity
    number: int
    state: CalibrationState
    standing: CalibrationStanding | None
    """Null: it was never accepted."""

    reasons: list[str]
    """Why it is not in force, in words."""

    run: CalibrationRun
    references: list[Reference]
    """Every standard that the device was compared with."""

    tolerance: float
    valid_days: int
    points: list[CalibrationPoint]
    result: CalibrationResult | None
    findings: list[Finding]
    made_by: str
    made_at: datetime
    measured_at: datetime | None
    decided_by: str | None
    decided_at: datetime | None
    comment: str
    expires_at: datetime | None
    """Due date; null while it was not accepted."""

    withdrawn_by: str | None
    withdrawn_at: datetime | None
    withdrawn_because: str
    request_id: UUID | None
    """The request that waits for a second person; null: none does."""

    can: CalibrationRights


class StatedAccuracy(ApiAnswer):
    """What the maker states: a share of the value, or a number in the unit."""

    ratio: float | None
    absolute: float | None


class CalibratedQuantity(ApiAnswer):
    """What can be calibrated of a device, and what was."""

    quantity: CalibrationQuantity
    unit: str
    is_relative: bool
    """Its uncertainty is a share of the value; else it is in the unit."""

    may_begin: bool
    stated: StatedAccuracy | None
    """What the maker states; null: nothing."""

    newest: UUID | None
    """The newest that was ever accepted."""

    history: list[CalibrationDetail]
    """Those of this page, newest first."""


class CalibrationsOfDevice(ApiAnswer):
    """A page of the calibrations of a device, by quantity."""

    quantities: list[CalibratedQuantity]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class CalibrationChange(ApiAnswer):
    """What a decision changes: the calibration that holds now, and the one that waits."""

    device: NamedRef
    quantity: CalibrationQuantity
    unit: str
    is_relative: bool
    becomes: CalibrationDetail
    was: CalibrationDetail | None
    """Null: the device was never calibrated."""
