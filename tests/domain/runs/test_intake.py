"""What one event of a host means for its job."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.crutd.settlement import OutcomeKind
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import StateError
from labweb.domain.runs.states.host_event_meaning import Meaning, read_event
from labweb.domain.runs.states.job_states import JobState

_J = JobState


@pytest.mark.parametrize(
    ("kind", "body", "current", "after", "answered"),
    [
        ("accepted", {}, _J.DISPATCHED, _J.ACCEPTED, ("do",)),
        ("accepted", {}, _J.STOPPED, None, ("do",)),
        ("stopped", {}, _J.DISPATCHED, _J.STOPPED, ("do", "cancel", "resolve")),
        ("rejected", {}, _J.ACCEPTED, _J.REJECTED, ("do", "cancel", "resolve")),
        ("in_doubt", {}, _J.RUNNING, _J.IN_DOUBT, ("do", "cancel")),
        ("complete", {}, _J.COMPLETING, _J.COMPLETE, ("do", "cancel", "resolve")),
        ("refused", {"command": "do"}, _J.DISPATCHED, _J.REJECTED, ("do", "cancel", "resolve")),
        ("refused", {"command": "do"}, _J.STOPPED, None, ("do",)),
        ("refused", {"command": "cancel"}, _J.RUNNING, None, ("cancel",)),
        ("refused", {"command": "cancel"}, _J.DISPATCHED, None, ("cancel",)),
        ("refused", {"command": "resolve"}, _J.IN_DOUBT, None, ("resolve",)),
        ("armed", {}, _J.RUNNING, None, ()),
    ],
)
def test_an_event_moves_its_job_and_answers_commands(
    kind: str, body: dict[str, Any], current: JobState, after: JobState | None, answered: object
) -> None:
    meaning = read_event(kind, body, current)
    assert (meaning.state, meaning.answered) == (after, answered)


def test_a_started_action_only_advances_its_transaction() -> None:
    started = read_event("started", {}, _J.ACCEPTED)
    assert started == Meaning(state=_J.RUNNING, advance=TransactionState.EXECUTING)
    assert read_event("actuated", {}, _J.RUNNING).advance is TransactionState.CONFIRMING


def test_what_did_not_start_moved_nothing_and_what_is_in_doubt_is_unknown() -> None:
    rejected = read_event("rejected", {}, _J.ACCEPTED).outcome
    doubtful = read_event("in_doubt", {}, _J.RUNNING).outcome
    assert rejected is not None
    assert (rejected.kind, rejected.moved_nl) == (OutcomeKind.PARTIAL, 0)
    assert doubtful is not None
    assert doubtful.kind is OutcomeKind.UNKNOWN


def test_an_answer_ends_the_doubt_with_its_outcome() -> None:
    body = {"state": "aborted", "outcome": {"kind": "partial", "moved_nl": 5}}
    meaning = read_event("resolved", body, _J.IN_DOUBT)
    assert meaning.is_resolution
    assert meaning.state is _J.ABORTED
    assert meaning.outcome is not None
    assert meaning.outcome.moved_nl == 5


@pytest.mark.parametrize(
    ("kind", "current"),
    [
        ("started", _J.DISPATCHED),
        ("complete", _J.ACCEPTED),
        ("started", _J.STOPPED),
        ("rejected", _J.RUNNING),
        ("in_doubt", _J.COMPLETE),
    ],
)
def test_a_story_that_skips_a_state_is_refused(kind: str, current: JobState) -> None:
    with pytest.raises(StateError):
        read_event(kind, {}, current)
