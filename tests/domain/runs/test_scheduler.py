"""What becomes of a run when one more of its jobs is sent."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from uuid import UUID

import pytest

from labweb.domain.runs.dispatch.job_scheduler import JobView, run_state, state_after_dispatch
from labweb.domain.runs.states.job_states import JobState, RunState

HOST = UUID(int=1)


def _job(index: int, state: JobState, *, is_passed: bool) -> JobView:
    return JobView(
        id=UUID(int=index + 2),
        index=index,
        state=state,
        after=(),
        host_id=HOST,
        is_passed=is_passed,
    )


def test_the_state_after_a_dispatch_is_what_the_jobs_say() -> None:
    """For every run of three jobs of which one is queued, whatever the others are."""
    count = 0
    for first, second, is_passed in product(JobState, JobState, (False, True)):
        jobs = [
            _job(0, first, is_passed=is_passed),
            _job(1, second, is_passed=is_passed),
            _job(2, JobState.QUEUED, is_passed=False),
        ]
        for before in (RunState.QUEUED, RunState.RUNNING):
            if run_state(before, jobs) is not before:
                continue
            sent = [*jobs[:2], replace(jobs[2], state=JobState.DISPATCHED)]
            assert state_after_dispatch(before) is run_state(before, sent)
            count += 1
    assert count > 50


def test_the_jobs_decide_about_a_run_that_waits_for_a_person() -> None:
    for state in set(RunState) - {RunState.QUEUED, RunState.RUNNING}:
        assert state_after_dispatch(state) is None


@pytest.mark.parametrize(
    ("is_given_up", "expected"), [(False, RunState.PAUSED), (True, RunState.ABORTED)]
)
def test_a_run_is_not_complete_while_nobody_has_answered_for_a_step_that_a_halt_undid(
    is_given_up: bool, expected: RunState
) -> None:
    done = _job(0, JobState.COMPLETE, is_passed=False)
    skipped = _job(1, JobState.ABORTED, is_passed=True)
    undone = replace(done, is_taken_away=True)
    for jobs in ([undone], [undone, skipped]):
        assert run_state(RunState.PAUSED, jobs, is_given_up=is_given_up) is expected
    assert run_state(RunState.PAUSED, [done, skipped]) is RunState.COMPLETE


def test_a_run_with_a_step_that_a_halt_undid_waits_for_a_person_whatever_else_goes_on() -> None:
    undone = replace(_job(0, JobState.COMPLETE, is_passed=False), is_taken_away=True)
    moving = _job(1, JobState.RUNNING, is_passed=False)
    waiting = _job(2, JobState.QUEUED, is_passed=False)
    assert run_state(RunState.RUNNING, [undone, moving, waiting]) is RunState.PAUSING
    assert run_state(RunState.RUNNING, [undone, waiting]) is RunState.PAUSED
