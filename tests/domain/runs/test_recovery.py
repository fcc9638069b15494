"""What a person has to say before a run can go on."""

from __future__ import annotations

import pytest

from labweb.domain.runs.after_failure.recovery_choices import RunWaitCause, run_waits_for, waits_for
from labweb.domain.runs.halts.halted_setpoints import LET_GO
from labweb.domain.runs.states.job_states import JobState


@pytest.mark.parametrize("state", JobState)
@pytest.mark.parametrize("is_passed", [False, True])
@pytest.mark.parametrize("halted_by", ["", LET_GO, "edge.stopped"])
def test_each_job_waits_for_an_answer_for_recovery_or_for_nothing(
    state: JobState, halted_by: str, *, is_passed: bool
) -> None:
    found = waits_for(state, is_passed=is_passed, halted_by=halted_by)
    undone = {JobState.ABORTED, JobState.REJECTED, JobState.STOPPED}
    if state is JobState.IN_DOUBT:
        assert found is RunWaitCause.ANSWER
    elif state in undone and not is_passed:
        assert found is RunWaitCause.RECOVERY
    elif state is JobState.COMPLETE and halted_by == "edge.stopped":
        assert found is RunWaitCause.RECOVERY, "a halt undid it, whatever was decided before"
    else:
        assert found is None


def test_a_run_waits_for_what_its_jobs_wait_for_and_for_answers_first() -> None:
    assert run_waits_for([]) is None
    assert run_waits_for([None, None]) is None
    assert run_waits_for([None, RunWaitCause.RECOVERY]) is RunWaitCause.RECOVERY
    assert run_waits_for([RunWaitCause.RECOVERY, None, RunWaitCause.ANSWER]) is RunWaitCause.ANSWER
