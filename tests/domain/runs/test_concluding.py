"""How an action ends when what had to confirm it could not be observed."""

from __future__ import annotations

from typing import Any
from uuid import UUID

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.crutd.pre_and_postconditions import (
    Condition,
    ConditionResult,
    ConditionVerdict,
    Verification,
    evaluate,
    unreadable_baselines,
)
from labweb.domain.crutd.settlement import OutcomeKind
from labweb.domain.runs.host_journal.action_states import ActionReport, ActionState, conclude

BALANCE, PUMP = UUID(int=1), UUID(int=2)
PLUNGER = Condition(name="pump.syringe_volume", device_id=PUMP, status="volume_ul", high=0.0)
MASS = Condition(
    name="balance.mass_arrived",
    device_id=BALANCE,
    status="mass_mg",
    change=1000.0,
    tolerance=10.0,
    stable_status="is_stable",
    is_sensor=True,
)
FREE = Condition(
    name="balance.mass_arrived",
    device_id=BALANCE,
    status="mass_mg",
    change=1000.0,
    stable_status="is_stable",
    is_sensor=True,
    may_stay_unconfirmed=True,
)


def told(mass_mg: float | None, *, is_stable: bool | None) -> dict[tuple[UUID, str], Any]:
    readings = {"mass_mg": mass_mg, "is_stable": is_stable}
    return {(BALANCE, name): value for name, value in readings.items()}


BEFORE = told(0.0, is_stable=True)
SILENT: list[dict[tuple[UUID, str], Any]] = [
    {},
    told(None, is_stable=True),
    told(1000.0, is_stable=False),
    told(1000.0, is_stable=None),
]


@pytest.mark.parametrize("now", SILENT)
def test_a_confirmation_that_could_not_be_made_leaves_the_action_in_doubt(now: Any) -> None:  # noqa: ANN401
    found = conclude(ActionReport(ok=True), [(MASS, evaluate(MASS, now, BEFORE))])
    assert found.state is ActionState.IN_DOUBT
    assert found.outcome.kind is OutcomeKind.UNKNOWN
    assert found.code == "balance.mass_arrived"
    assert found.message.startswith("mass ")


@pytest.mark.parametrize("now", SILENT)
def test_a_step_that_may_stay_unconfirmed_is_complete_and_says_so(now: Any) -> None:  # noqa: ANN401
    seen = ConditionResult(name=PLUNGER.name, verdict=ConditionVerdict.PASS, message="volume: 0 µL")
    found = conclude(ActionReport(ok=True), [(PLUNGER, seen), (FREE, evaluate(FREE, now, BEFORE))])
    assert found.state is ActionState.COMPLETE
    assert found.verification is Verification.UNCONFIRMED
    assert found.code == "edge.unconfirmed"
    assert found.message.startswith("not confirmed: mass ")


def test_a_balance_that_contradicts_is_in_doubt_though_the_step_may_stay_unconfirmed() -> None:
    result = evaluate(FREE, told(3.0, is_stable=True), BEFORE)
    assert conclude(ActionReport(ok=True), [(FREE, result)]).state is ActionState.IN_DOUBT


def test_a_confirmation_that_was_made_is_sensed_whether_it_had_to_be_or_not() -> None:
    for condition in (MASS, FREE):
        result = evaluate(condition, told(1000.0, is_stable=True), BEFORE)
        found = conclude(ActionReport(ok=True), [(condition, result)])
        assert (found.verification, found.message) == (Verification.SENSED, "")


def test_a_mass_that_had_not_settled_before_the_start_confirms_nothing() -> None:
    result = evaluate(MASS, told(1000.0, is_stable=True), told(0.0, is_stable=False))
    assert result.verdict is ConditionVerdict.UNOBSERVABLE
    assert result.message == "mass had not settled before the start"


def test_an_action_whose_confirmation_cannot_be_read_before_is_not_begun() -> None:
    (result,) = unreadable_baselines([PLUNGER, MASS], {})
    assert (result.name, result.verdict) == (MASS.name, ConditionVerdict.UNOBSERVABLE)
    assert "was not begun" in result.message
    assert unreadable_baselines([FREE], {}) == []
    assert unreadable_baselines([MASS], BEFORE) == []


CONDITIONS = st.builds(
    Condition,
    name=st.just("a.b"),
    device_id=st.just(BALANCE),
    status=st.just("mass_mg"),
    is_sensor=st.booleans(),
    may_stay_unconfirmed=st.booleans(),
)
RESULTS = st.builds(
    ConditionResult,
    name=st.just("a.b"),
    verdict=st.sampled_from(ConditionVerdict),
    message=st.just("why"),
)


@given(st.lists(st.tuples(CONDITIONS, RESULTS), max_size=4))
def test_nothing_that_was_asked_for_is_dropped_in_silence(
    post: list[tuple[Condition, ConditionResult]],
) -> None:
    found = conclude(ActionReport(ok=True), post)
    unseen = [one for one, result in post if result.verdict is ConditionVerdict.UNOBSERVABLE]
    if any(not one.may_stay_unconfirmed for one in unseen):
        assert found.state is ActionState.IN_DOUBT
    elif unseen and found.state is ActionState.COMPLETE:
        assert (found.verification, found.code) == (Verification.UNCONFIRMED, "edge.unconfirmed")
    if found.state is ActionState.COMPLETE and not unseen:
        assert found.verification is not Verification.UNCONFIRMED
