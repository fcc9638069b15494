"""What is left of a run when the rest of it is planned again."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.errors import StateError
from labweb.domain.runs.after_failure.replanning import Stood, document_left, steps_left
from labweb.domain.runs.states.job_states import JobState


def steps(*ids: str) -> list[dict[str, Any]]:
    return [{"id": one, "kind": "transfer", "params": {"volume": "1 mL"}} for one in ids]


def edge(source: str, target: str) -> dict[str, str]:
    ports = {"source_port": "done", "target_port": "start"}
    return {"id": f"{source}{target}", "source": source, "target": target, **ports}


def job(step_id: str, state: JobState, **more: Any) -> Stood:  # noqa: ANN401 - any field
    known = {"action": "aspirate", "sentence": step_id} | more
    return Stood(step_id=step_id, state=state, **known)


def test_a_step_without_jobs_is_left_and_a_zero_is_no_half_of_one() -> None:
    jobs = [
        job("a", JobState.COMPLETE),
        job("b", JobState.COMPLETE, action="initialize"),
        job("b", JobState.QUEUED),
        job("d", JobState.ABORTED, passed_by="hand"),
    ]
    assert steps_left(jobs, steps("a", "b", "c", "d")) == {"b", "c"}


@pytest.mark.parametrize(
    ("jobs", "code"),
    [
        ([job("a", JobState.RUNNING)], "run.under_way"),
        ([job("a", JobState.QUEUED, is_confirmed=True)], "run.under_way"),
        ([job("a", JobState.COMPLETE), job("a", JobState.QUEUED)], "run.step_under_way"),
    ],
)
def test_what_acts_is_confirmed_or_half_done_is_waited_for(jobs: list[Stood], code: str) -> None:
    with pytest.raises(StateError) as caught:
        steps_left(jobs, steps("a", "b"))
    assert caught.value.code == code


def test_what_comes_after_a_step_that_is_left_out_waits_for_what_it_waited_for() -> None:
    edges = [edge("a", "b"), edge("b", "c"), edge("b", "d"), edge("a", "d")]
    whole = {"name": "W", "steps": steps("a", "b", "c", "d"), "edges": edges}
    left, before = document_left(whole, {"a", "b", "c", "d"}, "b", None)
    assert [step["id"] for step in left["steps"]] == ["a", "c", "d"]
    assert sorted((one["source"], one["target"]) for one in left["edges"]) == [
        ("a", "c"),
        ("a", "d"),
    ]
    assert before == {"volume": "1 mL"}
