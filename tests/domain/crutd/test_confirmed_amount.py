"""What is posted when a device moves in whole steps."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.crutd.settlement import confirmed_nl

STEP_NL = 1667


@given(st.integers(1, 5_000_000))
def test_an_amount_between_two_steps_is_confirmed_as_asked(asked_nl: int) -> None:
    moved_nl = round(round(asked_nl / STEP_NL) * STEP_NL)
    assert confirmed_nl(asked_nl, moved_nl, STEP_NL) == asked_nl


def test_an_amount_more_than_a_step_off_is_posted_as_measured() -> None:
    assert confirmed_nl(5_000_000, 4_990_000, STEP_NL) == 4_990_000


def test_without_a_stated_resolution_the_measured_amount_is_posted() -> None:
    assert confirmed_nl(5_000_000, 5_000_001, 0) == 5_000_001
