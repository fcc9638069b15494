"""The lab as every page shows it."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from labweb.common.answers import ApiAnswer
from labweb.domain.graph.lab_file.lab_model import LabMode
from labweb.domain.runs.host_link.host_session import SessionState


class StopHost(ApiAnswer):
    """A host, and whether it has acknowledged the stop of the lab."""

    id: UUID
    name: str
    state: SessionState
    acknowledged_at: datetime | None
    after_s: float | None
    """From the click to the acknowledgement."""


class LabStop(ApiAnswer):
    """The stop of a lab."""

    is_stopped: bool
    stop_id: UUID | None
    stopped_at: datetime | None
    stopped_by: str | None
    hosts: list[StopHost]


class LabCounts(ApiAnswer):
    """How many things of a lab want a look."""

    runs_live: int
    approvals_open: int
    drivers_open: int
    needs_you: int


class LabSummary(ApiAnswer):
    """The lab as every page shows it."""

    id: UUID
    key: str
    name: str
    mode: LabMode
    time_zone: str
    speed: float
    """How many times as fast as the clock on the wall its instruments are."""

    stop: LabStop
    counts: LabCounts
