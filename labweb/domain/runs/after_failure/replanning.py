"""Which steps of a run are left when the rest of it is planned again, and in which order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from labweb.domain.errors import StateError
from labweb.domain.runs.states.job_states import AT_EDGE, UNSTARTED, JobState

_UNDER_WAY = AT_EDGE | {JobState.IN_DOUBT}
_BARE = frozenset({"device_action", "role_action"})
"""Steps that are an action of a device as such."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stood:
    """What counts of a job when the rest of its run is planned again."""

    step_id: str
    sentence: str
    action: str
    state: JobState
    passed_by: str = ""
    is_confirmed: bool = False
    """A person has confirmed what it asks: they may have done it by then."""


def steps_left(jobs: Iterable[Stood], steps: Sequence[Mapping[str, Any]]) -> set[str]:
    """Return the steps that are not done; one may have no jobs yet, for want of what is stated.

    Raises:
        StateError: `run.under_way`: a job acts, or was confirmed and is not sent yet;
            `run.step_under_way`: a step is half done.
    """
    kinds = {step["id"]: step["kind"] for step in steps}
    undone: set[str] = set()
    done: set[str] = set()
    for job in jobs:
        if job.state in _UNDER_WAY:
            raise StateError(f"{job.sentence!r} is under way: wait for it", code="run.under_way")
        if job.is_confirmed and job.state in UNSTARTED:
            text = f"{job.sentence!r} was confirmed and is not sent yet: wait for it"
            raise StateError(text, code="run.under_way")
        # The zero of a pump is looked for once, before all steps, and is no half of any.
        is_zero = job.action == "initialize" and kinds.get(job.step_id) not in _BARE
        if job.state is JobState.COMPLETE:
            done |= set() if is_zero else {job.step_id}
        elif job.passed_by in ("skip", "hand"):
            done.add(job.step_id)
        elif not job.passed_by:
            undone.add(job.step_id)
    if undone & done:
        text = "a step is half done: it cannot be planned again"
        raise StateError(text, code="run.step_under_way")
    return kinds.keys() - done


def document_left(
    whole: Mapping[str, Any], left: set[str], step_id: str, params: Mapping[str, Any] | None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the steps that are left as a document, and the step's values before.

    Without values the step itself is left out: what comes after it waits for what it waited for.
    """
    steps, before = [], {}
    for step in whole["steps"]:
        if step["id"] == step_id and params is None:
            before = dict(step["params"])
        elif step["id"] == step_id:
            before = {name: step["params"].get(name) for name in params or {}}
            steps.append({**step, "params": {**step["params"], **(params or {})}})
        elif step["id"] in left:
            steps.append(step)
    edges = whole["edges"] if params is not None else _without(whole["edges"], step_id)
    known = {step["id"] for step in steps}
    edges = [one for one in edges if one["source"] in known and one["target"] in known]
    return {**whole, "steps": steps, "edges": edges}, before


def _without(edges: Sequence[Mapping[str, Any]], step_id: str) -> list[dict[str, Any]]:
    """Return the edges once a step is gone: those before it lead to those after it."""
    left = [dict(edge) for edge in edges if step_id not in (edge["source"], edge["target"])]
    before = dict.fromkeys(edge["source"] for edge in edges if edge["target"] == step_id)
    after = dict.fromkeys(edge["target"] for edge in edges if edge["source"] == step_id)
    joined = {(edge["source"], edge["target"]) for edge in left}
    order = {"source_port": "done", "target_port": "start"}
    return left + [
        {"id": f"{source}-{target}"[:80], "source": source, "target": target, **order}
        for source in before
        for target in after
        if (source, target) not in joined
    ]
