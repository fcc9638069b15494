"""What the first page shows."""

from __future__ import annotations

from datetime import datetime
from typing import Literal
from uuid import UUID

from labweb.common.answers import ApiAnswer
from labweb.fleet.answers.devices import DeviceRow
from labweb.fleet.answers.hosts import HostRow
from labweb.runs.answers.run_rows import RunRow
from labweb.runs.answers.workflows import WorkflowOverview

NeedKind = Literal[
    "in_doubt",
    "asks",
    "approval",
    "paused",
    "quarantined",
    "ticket",
    "stopped",
    "candidate",
    "halt_owed",
    "silent",
    "disk",
]


class HomeNeed(ApiAnswer):
    """One thing that needs a person."""

    kind: NeedKind
    title: str
    detail: str
    since_at: datetime | None
    """Null: nobody knows since when."""

    url: str
    """The page on which it is dealt with; empty: there is none."""

    verb: str
    run_id: UUID | None
    job_id: UUID | None
    request_id: UUID | None
    """The request for approval."""


class HomePage(ApiAnswer):
    """What a person sees first."""

    needs_you: list[HomeNeed]
    running: list[RunRow]
    last_results: list[RunRow]
    workflows: list[WorkflowOverview]
    devices: list[DeviceRow]
    hosts: list[HostRow]
