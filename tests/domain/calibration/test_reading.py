"""Readings and what a calibration makes of them."""

from __future__ import annotations

from uuid import UUID

from labweb.domain.calibration.corrected_reading import corrected
from labweb.domain.calibration.correction import (
    AcceptedCalibration,
    CalibrationQuantity,
    CorrectionLevel,
    correction_of,
)

PROBE = AcceptedCalibration(
    id=UUID(int=3),
    quantity=CalibrationQuantity.PH,
    number=4,
    gain=1.05,
    offset=-0.35,
    levels=(CorrectionLevel(value=4.0, expanded=0.04), CorrectionLevel(value=6.87, expanded=0.05)),
)


def value(raw: object) -> object:
    """Return the corrected pH of what a probe told."""
    told = corrected([correction_of(PROBE, "value_ph", None)], {"value_ph": raw})
    return told.get("value_ph", {"value": "nothing"})["value"]


def test_a_reading_is_kept_raw_and_corrected() -> None:
    (told,) = corrected(
        [correction_of(PROBE, "value_ph", None)], {"value_ph": 5.0, "temperature_c": 22.0}
    ).values()
    assert told == {"raw": 5.0, "value": 4.9, "calibration_id": str(PROBE.id), "number": 4}


def test_beyond_the_buffers_nothing_is_extrapolated() -> None:
    assert value(6.9) == 6.895
    assert value(7.0) is None
    assert value(2.0) is None


def test_what_is_no_number_is_not_corrected() -> None:
    assert value("broken") == "nothing"
    assert value(True) == "nothing"


def test_a_number_that_was_sent_is_no_reading() -> None:
    assert corrected([correction_of(PROBE, "value_ph", 5.0)], {"value_ph": 5.0}) == {}
