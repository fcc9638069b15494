"""The plan of a run, or of a workflow that is checked."""

from __future__ import annotations

from typing import Any

from labweb.common.answers import ApiAnswer, NamedRef
from labweb.domain.workflows.plan import PlannedStep


class PlanJob(ApiAnswer):
    """One action of a plan on one device."""

    index: int
    step_id: str
    sentence: str
    device: NamedRef
    choices_count: int
    """How many devices may do it, where its step asks for a role; 0: its device alone."""

    action: str
    args: dict[str, Any]
    after: list[int]
    """Places in the plan of the jobs that must have completed."""

    estimate_s: float


class UnprovedStep(ApiAnswer):
    """A step that no proof covers."""

    step_id: str
    why: str


class PlanProof(ApiAnswer):
    """Steps whose movements of matter a plan was proved to make, and those beyond the proof."""

    steps: list[str]
    beyond: list[UnprovedStep]


class PlanView(ApiAnswer):
    """A plan with the names of its devices."""

    digest: str
    estimate_s: float
    steps: list[PlannedStep]
    jobs: list[PlanJob]
    notes: list[str]
    proved: PlanProof | None
    """What of it was carried out on paper; null: it is of before there was a proof."""
