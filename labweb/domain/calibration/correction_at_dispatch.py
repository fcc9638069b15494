"""Whether numbers that a calibration has made right still are, at the moment they are sent."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from uuid import UUID

from labweb.domain.calibration.calibration_result import as_text
from labweb.domain.calibration.correction import (
    IS_RELATIVE,
    AcceptedCalibration,
    CalibrationStanding,
    Correction,
)
from labweb.domain.errors import Finding

_CODES: Mapping[CalibrationStanding, str] = {
    CalibrationStanding.WITHDRAWN: "calibration.withdrawn",
    CalibrationStanding.CHANGED: "calibration.changed",
    CalibrationStanding.EXPIRED: "calibration.expired",
}
_WHAT_TO_DO = (
    "calibrate the device, then change the rest of the run or start it again, so that its numbers "
    "are made anew"
)


def check_sending(
    device: str,
    corrections: Iterable[Correction],
    known: Mapping[UUID, AcceptedCalibration],
    newest: Mapping[str, int],
) -> list[Finding]:
    """List why a job may not go with the numbers that it was planned with; empty means go.

    A calibration that is not in force any more made numbers that nobody vouches for: nothing goes
    with them. One that a newer one has superseded keeps what was planned with it, unless the step
    asks how sure it is.

    Args:
        device: Its name.
        corrections: Of the job.
        known: The calibrations that made them, with their standing now, by id.
        newest: Number of the newest accepted calibration, by quantity.
    """
    return [
        finding
        for one in corrections
        for finding in _check(device, one, known.get(one.calibration_id), newest)
    ]


def _check(
    device: str, one: Correction, found: AcceptedCalibration | None, newest: Mapping[str, int]
) -> Iterator[Finding]:
    what = f"calibration {one.number} of {one.quantity.value} of {device}"
    if found is None:
        yield Finding("calibration.missing", f"{what} is not there any more: {_WHAT_TO_DO}")
        return
    is_only_read = one.asked is None and one.needs is None
    if not found.is_in_force and not (
        is_only_read and found.standing is CalibrationStanding.EXPIRED
    ):
        text = f"{what} does not hold any more ({'; '.join(found.reasons)}): {_WHAT_TO_DO}"
        yield Finding(_CODES[found.standing], text)
        return
    if one.needs is None:
        return
    last = newest.get(one.quantity.value, one.number)
    if last > one.number:
        text = f"{what} was superseded by number {last}: change the rest of the run, or start anew"
        yield Finding("calibration.superseded", text)
    yield from _check_uncertainty(what, one, found, one.needs)


def _check_uncertainty(
    what: str, one: Correction, found: AcceptedCalibration, needs: float
) -> Iterator[Finding]:
    values = [level.value for level in found.levels] if one.asked is None else [one.asked]
    for value in values:
        expanded = found.expanded_at(value)
        reached = expanded and (expanded / value if IS_RELATIVE[one.quantity] else expanded)
        if reached is None or reached > needs:
            told = "nothing is known" if reached is None else as_text(one.quantity, reached)
            text = f"{what} is not sure enough at {value:g}: {told}, and the step needs "
            yield Finding("calibration.too_uncertain", text + as_text(one.quantity, needs))
