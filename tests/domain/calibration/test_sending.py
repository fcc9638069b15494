"""What may still be sent with the numbers that a calibration has made right."""

from __future__ import annotations

from uuid import UUID

import msgspec
import pytest

from labweb.domain.calibration.correction import (
    AcceptedCalibration,
    CalibrationQuantity,
    CalibrationStanding,
    Correction,
    CorrectionLevel,
    correction_of,
)
from labweb.domain.calibration.correction_at_dispatch import check_sending

PUMP = AcceptedCalibration(
    id=UUID(int=1),
    quantity=CalibrationQuantity.VOLUME,
    number=3,
    gain=0.97,
    levels=(CorrectionLevel(value=97.0, expanded=0.5), CorrectionLevel(value=970.0, expanded=2.0)),
)


def codes(
    standing: CalibrationStanding = CalibrationStanding.IN_FORCE,
    needs: float | None = None,
    newest: int = 3,
) -> list[str]:
    correction: Correction = correction_of(PUMP, "volume_ul", 485.0)
    correction = msgspec.structs.replace(correction, needs=needs)
    known = msgspec.structs.replace(PUMP, standing=standing, reasons=("why",))
    found = check_sending("Pump", [correction], {PUMP.id: known}, {"volume": newest})
    return [one.code for one in found]


@pytest.mark.parametrize(
    ("standing", "unasked", "asked"),
    [
        (CalibrationStanding.IN_FORCE, [], []),
        (CalibrationStanding.EXPIRED, ["calibration.expired"], ["calibration.expired"]),
        (CalibrationStanding.CHANGED, ["calibration.changed"], ["calibration.changed"]),
        (CalibrationStanding.WITHDRAWN, ["calibration.withdrawn"], ["calibration.withdrawn"]),
    ],
)
def test_a_number_goes_only_while_the_calibration_that_made_it_is_in_force(
    standing: CalibrationStanding, unasked: list[str], asked: list[str]
) -> None:
    assert codes(standing) == unasked
    assert codes(standing, needs=0.01) == asked


def test_a_reading_nobody_asks_an_accuracy_of_is_taken_past_the_due_date() -> None:
    read = correction_of(PUMP, "volume_ul", None)
    known = msgspec.structs.replace(PUMP, standing=CalibrationStanding.EXPIRED, reasons=("why",))
    assert check_sending("Pump", [read], {PUMP.id: known}, {}) == []
    asked = msgspec.structs.replace(read, needs=0.01)
    (finding,) = check_sending("Pump", [asked], {PUMP.id: known}, {})
    assert finding.code == "calibration.expired"


def test_a_newer_one_keeps_a_plan_unless_its_step_asks_how_sure_it_is() -> None:
    assert codes(newest=4) == []
    assert codes(newest=4, needs=0.01) == ["calibration.superseded"]


def test_the_uncertainty_is_looked_at_again() -> None:
    assert codes(needs=0.006) == []
    assert codes(needs=0.005) == ["calibration.too_uncertain"]


def test_a_calibration_that_is_gone_is_named() -> None:
    correction = correction_of(PUMP, "volume_ul", 485.0)
    (finding,) = check_sending("Pump", [correction], {}, {})
    assert finding.code == "calibration.missing"
    assert "calibration 3 of volume of Pump" in finding.message
