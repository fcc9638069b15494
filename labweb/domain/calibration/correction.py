"""A calibration, what it corrects, and how sure a corrected value is.

Words as in JCGM 200:2012 (VIM): *calibration* 2.39, *correction* 2.53, *expanded measurement
uncertainty* 2.35 with *coverage factor* 2.38 (here always k = 2, about 95 %).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import datetime
from enum import StrEnum
from itertools import pairwise
from uuid import UUID

import msgspec

COVERAGE_FACTOR = 2.0
"""Every expanded uncertainty here is this times a standard uncertainty."""

DIGITS = 6
"""Decimals that are kept of a corrected number, as all numbers of a plan."""


class CalibrationQuantity(StrEnum):
    """What can be calibrated."""

    VOLUME = "volume"
    """A pump's volume in µL, against the mass of water on a balance."""

    PH = "ph"
    """A probe's pH, against buffers."""

    TEMPERATURE = "temperature"
    """A heater's or thermostat's °C, against a reference thermometer."""


IS_RELATIVE: Mapping[CalibrationQuantity, bool] = {
    CalibrationQuantity.VOLUME: True,
    CalibrationQuantity.PH: False,
    CalibrationQuantity.TEMPERATURE: False,
}
"""Whether its uncertainty is asked for as a share of the value (1 %) or in its own unit."""

SYMBOLS: Mapping[CalibrationQuantity, str] = {
    CalibrationQuantity.VOLUME: "µL",
    CalibrationQuantity.PH: "pH",
    CalibrationQuantity.TEMPERATURE: "°C",
}


class CalibrationStanding(StrEnum):
    """Whether a calibration may be relied on now."""

    IN_FORCE = "in_force"
    EXPIRED = "expired"
    """Its due date is past."""

    CHANGED = "changed"
    """The device is not what was calibrated: another driver, other settings, or a repair."""

    WITHDRAWN = "withdrawn"
    """A person took it back."""


class CorrectionLevel(msgspec.Struct, frozen=True, kw_only=True):
    """How sure a corrected value is at one calibrated level."""

    value: float
    """The true value, in the quantity's unit."""

    expanded: float
    """Expanded uncertainty (k = 2) of one value there, in the same unit."""


class AcceptedCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """An accepted calibration of one quantity of one device.

    The device's own number and the true one are linked by `true = offset + gain × device`.
    """

    id: UUID
    quantity: CalibrationQuantity
    number: int
    """Version, from 1; a newer one supersedes it and never edits it."""

    gain: float
    offset: float = 0.0
    levels: tuple[CorrectionLevel, ...]
    """Calibrated levels, the lowest first. Nothing is said beyond the first and the last."""

    expires_at: datetime | None = None
    """Its due date; None: a calibration that never was a row, as in a trial."""

    standing: CalibrationStanding = CalibrationStanding.IN_FORCE
    reasons: tuple[str, ...] = ()
    """Why it is not in force, in words."""

    @property
    def is_in_force(self) -> bool:
        """Tell whether it corrects anything now."""
        return self.standing is CalibrationStanding.IN_FORCE

    def true_of(self, device_value: float) -> float:
        """Return the true value of a number of the device."""
        return round(self.offset + self.gain * device_value, DIGITS)

    def device_of(self, true_value: float) -> float:
        """Return the number that the device has to be given for a true value."""
        return round((true_value - self.offset) / self.gain, DIGITS)

    def expanded_at(self, true_value: float) -> float | None:
        """Return the expanded uncertainty of one value; None: it was not calibrated there.

        Between two levels the worse of both holds; of a relative quantity the worse share.

        Example:
            >>> levels = (Level(value=100.0, expanded=1.0), Level(value=1000.0, expanded=2.0))
            >>> one = Calibration(
            ...     id=UUID(int=1), quantity=Quantity.VOLUME, number=1, gain=1.0, levels=levels
            ... )
            >>> one.expanded_at(500.0), one.expanded_at(1000.0), one.expanded_at(99.0)
            (5.0, 2.0, None)
        """
        for level in self.levels:
            if level.value == true_value:
                return level.expanded
        for low, high in pairwise(self.levels):
            if low.value < true_value < high.value:
                if IS_RELATIVE[self.quantity]:
                    share = max(low.expanded / low.value, high.expanded / high.value)
                    return share * true_value
                return max(low.expanded, high.expanded)
        return None


class Correction(msgspec.Struct, frozen=True, kw_only=True):
    """One number of a command as it was asked and as it is sent, or one that it reads.

    Made by the planner alone.
    """

    argument: str
    """Argument of the action, `volume_ul`; or the status that it reads, `value_ph`."""

    quantity: CalibrationQuantity
    asked: float | None
    """True value that is wanted; None: it is read."""

    sent: float | None
    """Number that the device is given for it; None: it is read."""

    gain: float
    offset: float
    calibration_id: UUID
    number: int
    """Version of the calibration."""

    low: float | None = None
    high: float | None = None
    """For what is read: true values between which it was calibrated, with their uncertainty."""

    needs: float | None = None
    """Largest expanded uncertainty that the step allows, of a volume as a share; None: any."""

    expires_at: datetime | None = None
    """Due date of the calibration: from then on nothing acts with this number."""

    def true_of(self, device_value: float) -> float:
        """Return the true value of what the device tells of it; nothing stays nothing."""
        if device_value == 0 and self.quantity is CalibrationQuantity.VOLUME:
            return 0.0
        return round(self.offset + self.gain * device_value, DIGITS)


def correction_of(
    calibration: AcceptedCalibration, argument: str, asked: float | None
) -> Correction:
    """Return the correction of one argument; without a value, of one status that is read.

    Example:
        >>> levels = (Level(value=97.0, expanded=0.4), Level(value=970.0, expanded=1.0))
        >>> one = Calibration(
        ...     id=UUID(int=1), quantity=Quantity.VOLUME, number=1, gain=0.97, levels=levels
        ... )
        >>> correction_of(one, "volume_ul", 485.0).sent
        500.0
    """
    first, last = calibration.levels[0], calibration.levels[-1]
    return Correction(
        argument=argument,
        quantity=calibration.quantity,
        asked=asked,
        sent=None if asked is None else calibration.device_of(asked),
        gain=calibration.gain,
        offset=calibration.offset,
        calibration_id=calibration.id,
        number=calibration.number,
        expires_at=calibration.expires_at,
        low=None if asked is not None else first.value - first.expanded,
        high=None if asked is not None else last.value + last.expanded,
    )


def holds_s(corrections: Iterable[Correction], at: datetime) -> float | None:
    """Return for how long numbers may still be acted with; None: no calibration made them.

    Only what is sent counts: what is read says itself by which calibration it was corrected.

    Example:
        >>> from datetime import UTC, timedelta
        >>> at = datetime(2026, 1, 1, tzinfo=UTC)
        >>> one = Correction(
        ...     argument="volume_ul", quantity=Quantity.VOLUME, asked=1.0, sent=1.0, gain=1.0,
        ...     offset=0.0, calibration_id=UUID(int=1), number=1,
        ...     expires_at=at + timedelta(minutes=1),
        ... )
        >>> holds_s([one], at), holds_s([], at)
        (60.0, None)
    """
    ends = [
        one.expires_at
        for one in corrections
        if one.expires_at is not None and (one.asked is not None or one.needs is not None)
    ]
    return max(0.0, (min(ends) - at).total_seconds()) if ends else None
