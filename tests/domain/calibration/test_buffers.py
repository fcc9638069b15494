"""A probe in buffers: slope, offset, and what speaks against an electrode."""

from __future__ import annotations

from datetime import date
from typing import Any
from uuid import UUID

import pytest

from labweb.domain.calibration.calibration_order import Buffer, PhOrder, Reference, check_ph_order
from labweb.domain.calibration.calibration_result import CalibrationOutcome, Criteria, judge
from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.calibration.ph_buffers import BufferReading, buffer_ph, check_filling, points_of
from labweb.domain.calibration.ph_buffers_table import BUFFERS
from labweb.domain.errors import StateError

CRITERIA = Criteria(tolerance=0.1, least_levels=2, least_repeats=2, resolution=0.01)


def readings(
    slope: float, offset: float = 0.0, *, buffers: tuple[str, ...] = ("phthalate", "phosphate")
) -> list[BufferReading]:
    """Read buffers at 22 °C with an electrode of that slope about pH 7."""
    return [
        BufferReading(
            standard=name,
            value_ph=round(7 + (buffer_ph(name, 22.0) - 7) * slope + offset, 2),
            temperature_c=22.0,
            expanded=0.02,
            at_s=place * 60.0 + repeat,
        )
        for place, name in enumerate(buffers)
        for repeat in range(3)
    ]


def judged(made: list[BufferReading]) -> CalibrationOutcome:
    found = judge(CalibrationQuantity.PH, points_of(made), CRITERIA)
    assert isinstance(found, CalibrationOutcome)
    return found


def test_slope_and_offset_of_an_electrode_are_found() -> None:
    result = judged(readings(0.95, 0.1, buffers=("phthalate", "phosphate", "borax")))
    assert result.findings == ()
    assert result.slope_pct == pytest.approx(95.0, abs=0.3)
    assert result.offset_mv == pytest.approx(5.9, abs=0.6)
    for level in result.levels:
        assert abs(level.residual) < 0.01


@pytest.mark.parametrize(
    ("slope", "offset", "code"),
    [
        (0.90, 0.0, "calibration.electrode_slope"),
        (1.04, 0.0, "calibration.electrode_slope"),
        (0.98, 0.6, "calibration.electrode_offset"),
    ],
)
def test_a_worn_out_electrode_is_not_accepted(slope: float, offset: float, code: str) -> None:
    assert [one.code for one in judged(readings(slope, offset)).findings] == [code]


def test_one_buffer_gives_no_slope() -> None:
    found = judge(CalibrationQuantity.PH, points_of(readings(1.0, buffers=("borax",))), CRITERIA)
    assert not isinstance(found, CalibrationOutcome)
    assert [one.code for one in found] == ["calibration.too_few_points"]


def test_buffers_that_were_changed_round_are_not_monotone() -> None:
    made = readings(1.0)
    names = {"phthalate": "phosphate", "phosphate": "phthalate"}
    odd = [
        BufferReading(
            standard=names[one.standard], value_ph=one.value_ph, temperature_c=22.0,
            expanded=0.02, at_s=one.at_s,
        )
        for one in made
    ]  # fmt: skip
    assert "calibration.not_monotone" in {one.code for one in judged(odd).findings}


@pytest.mark.parametrize("standard", BUFFERS)
def test_a_buffer_outside_its_table_is_refused(standard: str) -> None:
    with pytest.raises(StateError) as caught:
        buffer_ph(standard, 60.0)
    assert caught.value.code == "calibration.buffer_temperature"


def test_a_vessel_that_keeps_too_much_of_a_buffer_or_is_not_empty_is_refused() -> None:
    assert check_filling(holds_nl=0, dead_ul=500.0, volume_ul=5000.0) == []
    found = check_filling(holds_nl=10, dead_ul=500.0, volume_ul=1000.0)
    assert [one.code for one in found] == ["calibration.not_empty", "calibration.carry_over"]


def an_order(**changes: Any) -> PhOrder:  # noqa: ANN401
    reference = Reference(name="Buffer", certificate="L-1", expanded=0.02, due_on=date(2099, 1, 1))
    buffers = [
        Buffer(source_id=UUID(int=place), standard=name, reference=reference)
        for place, name in enumerate(("phthalate", "phosphate"))
    ]
    ids = {name: UUID(int=9) for name in ("vessel_id", "waste_id", "pump_id")}
    return PhOrder(**{"buffers": buffers, "volume_ul": 5000.0, **ids, **changes})


def test_an_order_that_can_be_carried_out_has_no_findings() -> None:
    assert check_ph_order(an_order(), today=date(2026, 1, 1)) == []


def test_all_that_is_wrong_with_an_order_is_told() -> None:
    twice = [*an_order().buffers[:1], *an_order().buffers[:1]]
    bad = an_order(buffers=twice, repeats=1, tolerance=0.0, volume_ul=0.0, valid_days=0)
    found = check_ph_order(bad, today=date(2026, 1, 1))
    assert [one.code.removeprefix("calibration.") for one in found] == [
        "too_few_points", "too_few_points", "tolerance", "filling", "validity",
    ]  # fmt: skip
