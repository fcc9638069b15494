"""A heater's probe beside a reference thermometer: slope, offset, and what speaks against it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import date
from typing import Any
from uuid import UUID

import pytest

from labweb.domain.calibration.calibration_order import (
    Reference,
    TemperatureOrder,
    check_certificates,
    check_temperature_order,
)
from labweb.domain.calibration.calibration_result import CalibrationOutcome, Criteria, judge
from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.calibration.thermometer_comparison import RESOLUTION_C, Comparison, points_of
from labweb.domain.errors import Finding

CRITERIA = Criteria(tolerance=0.5, least_levels=3, least_repeats=2, resolution=RESOLUTION_C)
SET_POINTS_C = (30.0, 55.0, 80.0)


def compared(
    told: Callable[[float], float], set_points_c: Sequence[float] = SET_POINTS_C, repeats: int = 3
) -> list[Comparison]:
    """Hold set points with a probe that tells so much of a true temperature, and read both."""
    made = []
    for place, wanted_c in enumerate(set_points_c):
        for repeat in range(repeats):
            true_c = next(c / 100 for c in range(20_000) if told(c / 100) >= wanted_c)
            made.append(
                Comparison(
                    set_point_c=wanted_c,
                    sent_c=wanted_c,
                    indicated_c=round(told(true_c), 1),
                    reference_c=true_c,
                    at_s=place * 1000.0 + repeat * 60.0,
                )
            )
    return made


def judged(made: list[Comparison], **changes: Any) -> CalibrationOutcome | list[Finding]:  # noqa: ANN401
    criteria = Criteria(**{name: getattr(CRITERIA, name) for name in CRITERIA.__struct_fields__}
                        | changes)  # fmt: skip
    return judge(CalibrationQuantity.TEMPERATURE, points_of(made, 0.1), criteria)


def test_a_probe_three_percent_and_two_kelvin_off_is_right_to_half_a_percent_of_its_span() -> None:
    result = judged(compared(lambda true_c: 1.03 * true_c + 2.0))
    assert isinstance(result, CalibrationOutcome)
    assert result.findings == ()
    assert result.gain == pytest.approx(1 / 1.03, abs=0.002)
    for true_c in SET_POINTS_C:
        corrected_c = result.offset + result.gain * (1.03 * true_c + 2.0)
        assert abs(corrected_c - true_c) < 0.005 * (80.0 - 30.0)
    for level in result.levels:
        assert abs(level.error) > 2.5
        assert abs(level.residual) < 0.1 < level.expanded < 0.5


def test_how_far_the_probe_stood_from_its_set_point_is_part_of_the_uncertainty() -> None:
    steady = judged(compared(lambda true_c: true_c))
    wandering = [
        Comparison(
            set_point_c=one.set_point_c, sent_c=one.sent_c + 0.6, indicated_c=one.indicated_c,
            reference_c=one.reference_c, at_s=one.at_s,
        )
        for one in compared(lambda true_c: true_c)
    ]  # fmt: skip
    loose = judged(wandering)
    assert isinstance(steady, CalibrationOutcome)
    assert isinstance(loose, CalibrationOutcome)
    assert steady.findings == ()
    assert {one.code for one in loose.findings} == {"calibration.uncertainty"}
    for narrow, wide in zip(steady.levels, loose.levels, strict=True):
        assert wide.expanded > narrow.expanded + 0.4


@pytest.mark.parametrize(
    ("told", "code"),
    [
        (lambda c: c + 0.006 * (c - 30.0) * (80.0 - c), "calibration.not_linear"),
        (lambda c: c + 12.0, "calibration.probe"),
    ],
)
def test_what_a_slope_and_an_offset_do_not_correct_is_found(
    told: Callable[[float], float], code: str
) -> None:
    result = judged(compared(told))
    assert isinstance(result, CalibrationOutcome)
    assert code in {one.code for one in result.findings}


def test_two_set_points_are_no_calibration() -> None:
    found = judged(compared(lambda true_c: true_c, (30.0, 80.0)))
    assert isinstance(found, list)
    assert [one.code for one in found] == ["calibration.too_few_points"]


def test_a_reference_that_wandered_between_readings_makes_the_result_too_uncertain() -> None:
    made = [
        Comparison(
            set_point_c=one.set_point_c, sent_c=one.sent_c, indicated_c=one.indicated_c,
            reference_c=one.reference_c + (-1.0, 0.0, 1.0)[place % 3], at_s=one.at_s,
        )
        for place, one in enumerate(compared(lambda true_c: true_c))
    ]  # fmt: skip
    result = judged(made)
    assert isinstance(result, CalibrationOutcome)
    assert "calibration.uncertainty" in {one.code for one in result.findings}


def an_order(**changes: Any) -> TemperatureOrder:  # noqa: ANN401
    reference = Reference(name="Pt100", certificate="K-1", expanded=0.1, due_on=date(2099, 1, 1))
    wanted: dict[str, Any] = {
        "vessel_id": UUID(int=1),
        "thermometer_id": UUID(int=2),
        "reference": reference,
        "set_points_c": [30.0, 55.0, 80.0],
    }
    return TemperatureOrder(**wanted | changes)


def test_everything_that_speaks_against_an_order_is_listed() -> None:
    assert check_temperature_order(an_order(), today=date(2026, 1, 1)) == []
    bad = an_order(
        reference=Reference(name="", certificate="", expanded=0.0, due_on=date(2020, 1, 1)),
        set_points_c=[30.0, 30.0, 80.0],
        repeats=1,
        tolerance=0.0,
        settle_s=0.0,
        valid_days=0,
    )
    found = check_temperature_order(bad, today=date(2026, 1, 1))
    assert [one.code.removeprefix("calibration.") for one in found] == [
        "no_reference", "no_reference", "reference_expired", "too_few_points", "too_few_points",
        "tolerance", "settling", "validity",
    ]  # fmt: skip


def test_a_certificate_holds_on_its_last_day_and_not_on_the_next() -> None:
    reference = Reference(name="Pt100", certificate="K-1", expanded=0.1, due_on=date(2026, 5, 1))
    assert check_certificates([reference], on=date(2026, 5, 1)) == []
    (finding,) = check_certificates([reference], on=date(2026, 5, 2))
    assert finding.code == "calibration.reference_expired"
