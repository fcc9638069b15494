"""A pump against water: the fit, its uncertainty, and what speaks against it."""

from __future__ import annotations

import random

import pytest

from labweb.domain.calibration.calibration_result import CalibrationOutcome, Criteria, judge
from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.calibration.gravimetric_volume import (
    Surroundings,
    Weighing,
    check_evaporation,
    check_surroundings,
    points_of,
)
from labweb.domain.calibration.water_density import z_factor_ul_mg
from labweb.domain.errors import Finding, StateError

AIR = Surroundings(water_c=22.0, pressure_kpa=101.3)
CRITERIA = Criteria(
    tolerance=0.005, least_levels=3, least_repeats=3, full_scale=5000.0, resolution=0.2
)


def weighings(
    gain: float = 0.97,
    *,
    lost_ul: float = 0.0,
    per_s: float = 0.0,
    creep: float = 0.0,
    levels: tuple[float, ...] = (500.0, 2500.0, 5000.0),
    repeats: int = 3,
) -> list[Weighing]:
    """Weigh a pump that moves `gain` of what it is told, on a pan that loses `per_s` mg/s."""
    noise, z = random.Random(7), z_factor_ul_mg(22.0, 101.3)
    mass_mg, at_s, made = 0.0, 0.0, []
    for _ in range(repeats):
        for level in levels:
            before = mass_mg + noise.gauss(0, 0.05)
            moved = level * (gain + creep * at_s) - lost_ul
            mass_mg += moved / z - 20 * per_s
            after = mass_mg + noise.gauss(0, 0.05)
            made.append(
                Weighing(
                    asked_ul=level, indicated_ul=level, before_mg=before, after_mg=after,
                    before_s=at_s, after_s=at_s + 20,
                )
            )  # fmt: skip
            mass_mg -= 5 * per_s
            at_s += 25
    return made


def judged(made: list[Weighing], *others: Finding) -> CalibrationOutcome:
    found = judge(CalibrationQuantity.VOLUME, points_of(made, AIR, 0.4), CRITERIA, others=others)
    assert isinstance(found, CalibrationOutcome)
    return found


def codes(result: CalibrationOutcome) -> set[str]:
    return {one.code for one in result.findings}


def test_a_pump_that_moves_three_percent_too_little_is_found_and_corrected() -> None:
    result = judged(weighings(0.97))
    assert result.findings == ()
    assert result.gain == pytest.approx(0.97, abs=2e-4)
    assert [round(level.error) for level in result.levels] == [15, 75, 150]
    for level in result.levels:
        assert abs(level.residual) / level.reference < 0.0005
        assert level.expanded / level.reference < 0.005


def test_the_certified_range_ends_at_the_true_value_of_the_last_level() -> None:
    levels = judged(weighings(0.97)).certified()
    assert levels[0].value == pytest.approx(485, abs=0.5)
    assert levels[-1].value == pytest.approx(4850, abs=2)


def test_a_loss_with_every_stroke_is_no_gain() -> None:
    assert "calibration.offset" in codes(judged(weighings(1.0, lost_ul=20.0)))


def test_a_wrong_syringe_is_not_corrected() -> None:
    assert "calibration.gain" in codes(judged(weighings(0.5)))


def test_without_the_full_stroke_nothing_is_extrapolated() -> None:
    made = weighings(levels=(500.0, 1500.0, 2500.0))
    assert "calibration.span" in codes(judged(made))


def test_too_few_levels_and_too_few_repeats_are_all_told() -> None:
    made = weighings(levels=(500.0, 5000.0), repeats=2)
    found = judge(CalibrationQuantity.VOLUME, points_of(made, AIR, 0.4), CRITERIA)
    assert not isinstance(found, CalibrationOutcome)
    assert [one.code for one in found] == ["calibration.too_few_points"] * 3


def test_a_pump_that_moves_less_for_more_is_not_monotone() -> None:
    made = weighings()
    odd = [
        Weighing(
            asked_ul=one.asked_ul, indicated_ul=one.indicated_ul, before_mg=0,
            after_mg=5000 - one.asked_ul / 2, before_s=one.before_s, after_s=one.after_s,
        )
        for one in made
    ]  # fmt: skip
    assert "calibration.not_monotone" in codes(judged(odd))


def test_a_gain_that_creeps_is_drift() -> None:
    assert "calibration.drift" in codes(judged(weighings(creep=1e-4)))


def test_scatter_beyond_what_was_asked_for_is_refused() -> None:
    strict = Criteria(tolerance=1e-6, least_levels=3, least_repeats=3)
    found = judge(CalibrationQuantity.VOLUME, points_of(weighings(), AIR, 0.4), strict)
    assert isinstance(found, CalibrationOutcome)
    assert "calibration.uncertainty" in codes(found)


def test_water_that_evaporates_between_weighings_is_seen() -> None:
    assert check_evaporation(weighings(), 0.005) == []
    (found,) = check_evaporation(weighings(per_s=0.1), 0.005)
    assert found.code == "calibration.evaporation"


def test_hot_water_and_impossible_air_are_refused() -> None:
    found = check_surroundings(Surroundings(water_c=60, pressure_kpa=1013.0))
    assert [one.code for one in found] == ["calibration.not_water", "calibration.not_air"]
    with pytest.raises(StateError):
        z_factor_ul_mg(60.0, 101.3)
