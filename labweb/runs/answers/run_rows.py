"""A run as lists show it."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal
from uuid import UUID

import msgspec
from msgspec import UNSET, UnsetType

from labweb.common.answers import ApiAnswer
from labweb.domain.graph.lab_file.lab_model import LabMode
from labweb.domain.runs.states.job_states import RunState

RecoveryName = Literal["retry", "change", "done_by_hand", "skip"]


class RunWorkflow(ApiAnswer):
    """The version of a workflow that a run carries out."""

    id: UUID
    name: str
    version: int


class PauseReason(ApiAnswer, kw_only=True):
    """One reason why nothing more of a run begins."""

    kind: str
    by: str | None
    """Name of the person; empty or null: the server."""

    by_id: str | UnsetType = UNSET
    at: str
    """A resume names each pause that was seen by this, as it is written here."""


class RunRecovery(ApiAnswer, kw_only=True):
    """What a person chose about a job that ended undone."""

    choice: RecoveryName
    job_id: UUID
    by: str
    by_id: str | UnsetType = UNSET
    at: str
    note: str
    moved_nl: int | UnsetType | None = UNSET
    """What was moved by hand."""

    skipped_with: list[int] | UnsetType = msgspec.field(default=UNSET, name="with")
    """Places in the plan of what was skipped with it."""

    halted_by: str | UnsetType = UNSET
    """What had undone the job, where a person goes on without it."""

    step_id: str | UnsetType = UNSET
    """The step that was given other values."""

    before: dict[str, Any] | UnsetType | None = UNSET
    params: dict[str, Any] | UnsetType | None = UNSET
    plan_before: str | UnsetType = UNSET
    """Digest of the plan before the step was changed."""

    plan_after: str | UnsetType = UNSET
    departs: str | UnsetType = UNSET
    """How the run leaves what was proved; empty: it does not."""


class RunWait(ApiAnswer):
    """The run that another one waits for."""

    id: UUID
    number: int
    resource: str
    until_step: int | None
    text: str
    """The whole sentence: "waits for run #12, which holds Reactor 1 until its step 7"."""


class RunHoldRow(ApiAnswer):
    """Something that a run keeps for itself now."""

    resource_id: UUID
    resource: str
    is_shared: bool
    """Others may draw from it, or pour into it, too."""

    until_step: int


class RunRow(ApiAnswer):
    """A run as a list shows it."""

    id: UUID
    number: int
    workflow: RunWorkflow
    mode: LabMode
    state: RunState
    created_by: str
    created_at: datetime
    started_at: datetime | None
    ended_at: datetime | None
    steps_total: int
    steps_done: int
    step_now: str | None
    in_doubt_count: int
    estimate_s: float
    """From the first job to the last, by the clock on the wall."""

    left_s: float | None
    """Until the last job ends; null: the run has ended."""

    pause_reasons: list[PauseReason]
    waits_for: RunWait | None
    """The run that keeps what this one needs, or asked for it before."""

    holds: list[RunHoldRow]
    """What the run keeps for itself now."""

    recoveries: list[RunRecovery]
    is_given_up: bool
    """Somebody aborted it: it ends once each of its devices stands, or does not answer."""


class RunList(ApiAnswer):
    """A page of runs."""

    runs: list[RunRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""
