"""Which level answers a question."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.telemetry_resolution import (
    LEVELS_S,
    MOST_POINTS,
    RAW,
    SLACK_S,
    check_ages,
    choose_resolution,
)

DAY_S = 86400.0
KEPT_S = {RAW: DAY_S, 1: 7 * DAY_S, 60: 90 * DAY_S, 3600: 5 * 365 * DAY_S}


@given(
    st.floats(0, 1e10),
    st.floats(1e-3, 1e10),
    st.integers(1, MOST_POINTS),
    st.floats(0, 1e10),
)
def test_no_range_has_more_buckets_than_points_were_asked_for(
    since_s: float, span_s: float, points: int, age_s: float
) -> None:
    until_s = since_s + span_s
    if not since_s < until_s:
        return
    found = choose_resolution(since_s, until_s, points, now_s=since_s + age_s, kept_s=KEPT_S)
    assert found.level_s in LEVELS_S
    assert found.step_s % found.level_s == 0
    assert (until_s - since_s) / found.step_s <= points


def test_a_level_that_is_no_longer_kept_is_passed_over() -> None:
    now_s = 1e9
    for age_s, level_s in ((3600.0, 1), (8 * DAY_S, 60), (91 * DAY_S, 3600), (3650 * DAY_S, 3600)):
        since_s = now_s - age_s
        found = choose_resolution(since_s, since_s + 60, 1000, now_s=now_s, kept_s=KEPT_S)
        assert found.level_s == level_s


@pytest.mark.parametrize("points", [0, MOST_POINTS + 1])
def test_points_out_of_their_range_are_refused(points: int) -> None:
    with pytest.raises(ValueError, match="points"):
        choose_resolution(0, 1, points, now_s=1, kept_s=KEPT_S)


def test_an_empty_range_is_refused() -> None:
    with pytest.raises(ValueError, match="empty"):
        choose_resolution(2, 2, 10, now_s=2, kept_s=KEPT_S)


def test_ages_that_would_leave_a_bucket_without_its_source_are_named() -> None:
    assert check_ages(KEPT_S) == []
    assert check_ages(KEPT_S | {60: DAY_S}) == ["level 60 must be kept at least as long as level 1"]
    assert "at least" in check_ages(KEPT_S | {RAW: SLACK_S - 1})[0]
    assert check_ages({RAW: DAY_S})[0] == "the age of level 1 is not told"
    assert check_ages(KEPT_S | {3600: float("nan")}) != []
