"""A run whole, its events and its log."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from uuid import UUID

from msgspec import UNSET, UnsetType

from labweb.common.answers import ApiAnswer, NamedRef, NumberedRef
from labweb.crutd.answers import DoubtEnd
from labweb.domain.runs.after_failure.plan_departures import Departure
from labweb.domain.runs.halts.halt_progress import HaltState
from labweb.domain.workflows.plan import Execution
from labweb.runs.answers.jobs import JobRow
from labweb.runs.answers.plans import PlanView
from labweb.runs.answers.run_rows import RunRow
from labweb.telemetry.answers import FileState


class RunGivenUp(ApiAnswer):
    """Who aborted a run, when and why."""

    by: str
    at: str
    reason: str


class DeviceHaltRow(ApiAnswer):
    """A wish to halt one device, and what came of it."""

    id: UUID
    device: NamedRef
    state: HaltState
    message: str
    at: datetime
    ended_at: datetime | None
    run: NumberedRef | None
    """Run that was aborted; null: a person stopped the device."""

    by: str | None


class JobFile(ApiAnswer):
    """A file that a job of a run has measured, whether its bytes are here or not."""

    id: UUID
    job_id: UUID
    name: str
    format: str
    size_bytes: int
    state: FileState
    file_id: UUID | None
    code: str
    message: str


class RunProof(ApiAnswer):
    """How a run of a recipe leaves what was proved, and who let it go on so."""

    departures: list[Departure]
    accepted: list[Departure]
    by: str | None
    at: str | None


class RunApproval(ApiAnswer):
    """The request that a run waits for, or waited for."""

    id: UUID
    state: str


class HostAway(ApiAnswer):
    """A host that works alone: of its jobs in a run only what was last heard is known."""

    id: UUID
    name: str
    since_at: datetime | None
    jobs_count: int
    job_ids: list[UUID]


class SilentDevice(ApiAnswer):
    """A device on which something of a run stands, and of which it cannot be read back."""

    device: NamedRef
    since_at: datetime
    sentences: list[str]
    """What was set on it, in the order in which it was sent."""


class ContradictedAnswer(ApiAnswer):
    """An answer about a doubt that a device reads otherwise since; it is a ticket."""

    ticket_id: UUID
    text: str
    opened_at: datetime


class RunRights(ApiAnswer):
    """What the caller may do about a run as it stands."""

    pause: bool
    recover: bool
    confirm: bool
    resume: bool
    abort: bool
    resolve: bool


class RunDetail(RunRow):
    """A run whole."""

    document: dict[str, Any]
    """The workflow as its version has it."""

    plan: PlanView
    jobs: list[JobRow]
    given_up: RunGivenUp | None
    """Null: nobody aborted it, or it was before this was written down."""

    halts: list[DeviceHaltRow]
    """Of an aborted run: its devices that had to be halted, and what came of it."""

    files: list[JobFile]
    proof: RunProof | None
    """Null: it is no run of a recipe."""

    approval: RunApproval | None
    execution: Execution | None
    """What the workflow declares for hosts that cannot hear the server; null: nothing."""

    hosts_away: list[HostAway]
    silent: list[SilentDevice]
    contradicted: list[ContradictedAnswer]
    can: RunRights


class LogLine(ApiAnswer, kw_only=True):
    """One line of the log of a run: what a host reported, or how a vessel changed hands."""

    at: datetime
    received_at: datetime | UnsetType = UNSET
    """When the server heard of it; left out where no host reported the line."""

    uncertainty_s: float | UnsetType | None = UNSET
    is_bounded: bool | UnsetType = UNSET
    job_id: UUID
    job_index: int
    kind: str
    text: str
    resolved: DoubtEnd | UnsetType | None = UNSET
    """How a doubt ended that the line began; null: it is open, or it began none."""

    body: dict[str, Any]


class RunLogPage(ApiAnswer):
    """A page of the log of a run."""

    lines: list[LogLine]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""
