"""Workflows with their last runs, and what a workflow would mean on the lab."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from typing import Any
from uuid import UUID

from labweb.common.answers import ApiAnswer, NumberedRef
from labweb.domain.errors import Finding
from labweb.domain.runs.after_failure.recovery_choices import RunWaitCause
from labweb.domain.runs.states.job_states import RunState
from labweb.runs.answers.plans import PlanView
from labweb.workflows.answers import VersionRow


class CheckFinding(ApiAnswer):
    """One reason why something may not go."""

    code: str
    message: str
    subject: str
    """What it is about: a resource, step or position; empty: the whole."""

    context: dict[str, Any]


def check_findings(findings: Iterable[Finding]) -> list[CheckFinding]:
    """Say why something may not go."""
    return [
        CheckFinding(
            code=one.code, message=one.message, subject=one.subject, context=dict(one.context)
        )
        for one in findings
    ]


class WordsOfStep(ApiAnswer):
    """A part of the sentence that says what a step does."""

    text: str
    strong: bool
    """A person filled it in."""

    sort: str
    """`text`, `quantity`, `resource`, `name` or another sort of parameter."""


class DraftProof(ApiAnswer):
    """The version whose proof a draft has, and what took the proof away since."""

    version: int
    changes: list[CheckFinding]
    """None: the proof holds."""


class WorkflowCheck(ApiAnswer):
    """What a workflow would mean here and now."""

    findings: list[CheckFinding]
    plan: PlanView | None
    """Null: the findings say why there is none."""

    policies: list[str]
    """Name of each policy that asks for an approval."""

    sentences: dict[str, list[WordsOfStep]]
    """By step."""

    proof: DraftProof | None


class LastRunOf(ApiAnswer):
    """The newest run of a workflow."""

    id: UUID
    number: int
    state: RunState
    ended_at: datetime | None
    waits_for: RunWaitCause | None
    """What a person has to say before it can go on."""


class WorkflowOverview(ApiAnswer):
    """A workflow with its last run."""

    id: UUID
    name: str
    description: str
    is_template: bool
    latest_version: NumberedRef | None
    steps_count: int
    updated_at: datetime
    updated_by: str | None
    last_run: LastRunOf | None


class WorkflowOverviewList(ApiAnswer):
    """A page of workflows."""

    workflows: list[WorkflowOverview]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class WorkflowDetail(WorkflowOverview):
    """A workflow with its draft and versions."""

    draft: dict[str, Any]
    draft_revision: int
    versions: list[VersionRow]
    can_edit: bool
