"""What a plunger says of an action in doubt: the subtraction is shown, and nothing is guessed."""

from __future__ import annotations

from dataclasses import replace
from uuid import UUID

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.calibration.correction import CalibrationQuantity, Correction
from labweb.domain.runs.after_failure.doubt_by_readings import (
    Plunger,
    choices_after,
    contradiction,
    measure,
)
from labweb.domain.runs.after_failure.recovery_choices import Ended
from labweb.domain.runs.states.job_states import JobState

DISPENSE = Plunger(
    action="dispense", asked_nl=5_000_000, before_ul=10_000.0, after_ul=6_500.0, tolerance_ul=10.0
)
ASPIRATE = replace(DISPENSE, action="aspirate", before_ul=0.0, after_ul=3_500.0)


def test_what_moved_is_what_the_plunger_stood_at_less_what_it_stands_at() -> None:
    found = measure(DISPENSE)
    assert found.text == (
        "The plunger stood at 10.000 mL before and stands at 6.500 mL now: "
        "10.000 \N{MINUS SIGN} 6.500 = 3.500 mL moved."
    )
    assert (found.moved_nl, found.answer, found.tolerance_nl) == (3_500_000, "partly", 10_000)
    drawn = measure(ASPIRATE)
    assert drawn.text.endswith("3.500 \N{MINUS SIGN} 0.000 = 3.500 mL moved.")
    assert (drawn.moved_nl, drawn.answer) == (3_500_000, "partly")


@pytest.mark.parametrize(
    ("after_ul", "answer"),
    [(5_000.0, "happened"), (5_009.0, "happened"), (10_000.0, "did_not"), (9_995.0, "did_not"),
     (5_020.0, "partly"), (4_000.0, "")],
)  # fmt: skip
def test_the_answer_that_agrees_is_offered_and_none_where_more_moved_than_asked(
    after_ul: float, answer: str
) -> None:
    assert measure(replace(DISPENSE, after_ul=after_ul)).answer == answer


def test_a_missing_reading_is_named_and_nothing_is_guessed() -> None:
    found = measure(replace(DISPENSE, before_ul=None))
    assert (found.moved_nl, found.answer) == (None, "")
    assert found.text == (
        "Where the plunger stood before is missing: it was not read. It stands at 6.500 mL now."
    )
    why = "Pump 1 has not told it since"
    found = measure(replace(DISPENSE, after_ul=None, why_no_after=why))
    assert found.text == (
        f"Where the plunger stands now is missing: {why}. It stood at 10.000 mL before."
    )
    assert contradiction(found, "happened", asked_nl=5_000_000, moved_nl=None) is None


def test_a_plunger_that_went_the_other_way_tells_nothing() -> None:
    found = measure(replace(DISPENSE, after_ul=10_100.0))
    assert (found.moved_nl, found.answer) == (None, "")
    assert "other way" in found.text


def test_what_the_device_tells_is_made_true_by_the_calibration_that_it_was_sent_with() -> None:
    correction = Correction(
        argument="volume_ul", quantity=CalibrationQuantity.VOLUME, asked=5000.0, sent=4900.0,
        gain=1.02, offset=0.0, calibration_id=UUID(int=1), number=3,
    )  # fmt: skip
    found = measure(replace(DISPENSE, correction=correction))
    assert found.moved_nl == 3_570_000
    assert found.text.endswith("= 3.500 mL moved. By calibration 3 that is 3.570 mL.")


@pytest.mark.parametrize(
    ("answer", "moved_nl", "is_refused"),
    [("happened", None, True), ("did_not", None, True), ("partly", 3_500_000, False),
     ("partly", 3_509_000, False), ("partly", 3_520_000, True), ("discard", None, False)],
)  # fmt: skip
def test_an_answer_that_the_plunger_contradicts_is_found(
    answer: str, moved_nl: int | None, is_refused: bool
) -> None:
    found = contradiction(measure(DISPENSE), answer, asked_nl=5_000_000, moved_nl=moved_nl)
    assert (found is not None) is is_refused
    if found is not None:
        assert found.code == "run.contradicts_reading"
        assert found.context["measured_nl"] == 3_500_000
        assert "3.500 mL ± 0.010 mL" in found.message


@given(st.sampled_from(["aspirate", "dispense"]), st.floats(0, 5_000), st.floats(0, 5_000))
def test_the_answer_that_is_offered_never_contradicts_the_reading(
    action: str, before_ul: float, after_ul: float
) -> None:
    plunger = replace(DISPENSE, action=action, before_ul=before_ul, after_ul=after_ul)
    found = measure(plunger)
    if found.answer:
        moved = found.moved_nl if found.answer == "partly" else None
        assert contradiction(found, found.answer, asked_nl=5_000_000, moved_nl=moved) is None


def test_what_may_follow_an_answer_is_what_recovery_would_offer_then() -> None:
    undone = Ended(
        index=0, state=JobState.ABORTED, step_id="a", recovery="R2", has_moved=False, is_liquid=True
    )
    offered = {
        name: [one.name for one in choices_after(job, is_step_untouched=True) if not one.why_not]
        for name, job in {
            "did_not": undone,
            "partly": replace(undone, has_moved=True),
            "discard": replace(undone, is_unknown=True),
        }.items()
    }
    assert offered["did_not"] == ["retry", "done_by_hand", "skip"]
    assert offered["partly"] == offered["discard"] == ["done_by_hand", "skip"]
