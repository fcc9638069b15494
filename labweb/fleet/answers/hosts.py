"""What the endpoints of hosts answer with."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal
from uuid import UUID

from labweb.common.answers import ApiAnswer
from labweb.domain.runs.exclusive_use.resource_custody import CustodyState
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import JobState
from labweb.fleet.answers.devices import DeviceRow

DiskLevel = Literal["ok", "low", "full"]


class HostDisk(ApiAnswer):
    """The disk with the journal of a host, as it said last."""

    free_bytes: int
    level: DiskLevel
    text: str
    """What is warned of; empty: nothing."""


class HostRow(ApiAnswer):
    """One edge host in a list."""

    id: UUID
    key: str
    name: str
    state: SessionState
    last_seen_at: datetime | None
    epoch: int
    acked_seq: int
    journal_lag: int
    """Events of its journal that the server has not taken yet."""

    devices_count: int
    state_at: datetime | None
    away_since_at: datetime | None
    """When it was heard last before it was isolated; null: it is not."""

    clock_skew_s: float | None
    """The host's wall clock less the server's; shown, never decided by."""

    heartbeat: dict[str, Any]
    disk: HostDisk | None
    """Null: it has not said."""


class HostList(ApiAnswer):
    """A page of hosts."""

    hosts: list[HostRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class HostClosed(ApiAnswer):
    """Why a host is closed."""

    code: str
    message: str


class HostJob(ApiAnswer):
    """A job that a host was sent and that has not ended, or of which nobody knows."""

    id: UUID
    run_id: UUID
    run_number: int
    sentence: str
    state: JobState
    state_at: datetime | None


class HostTicket(ApiAnswer):
    """An open ticket about a host."""

    id: UUID
    code: str
    message: str
    opened_at: datetime


class HostMove(ApiAnswer):
    """A vessel on its way from or to a host."""

    id: UUID
    name: str
    place: str | None
    """Where it is to stand."""

    state: CustodyState
    is_leaving: bool
    at: datetime


class HostFence(ApiAnswer):
    """The first of two signatures that declare a host lost."""

    first_by: str
    first_at: datetime
    reason: str
    is_mine: bool


class HostRights(ApiAnswer):
    """What the caller may do with a host."""

    fence: bool
    readmit: bool
    revoke: bool


class HostDetail(HostRow):
    """One edge host whole."""

    floor: int
    """Dispatches below it were given up."""

    last_dseq: int
    epoch_seen: int
    journal_id: UUID | None
    reason: HostClosed | None
    devices: list[DeviceRow]
    jobs: list[HostJob]
    tickets: list[HostTicket]
    moves: list[HostMove]
    fence: HostFence | None
    can: HostRights


class HostStanding(ApiAnswer):
    """How a host stands after an act."""

    id: UUID
    state: SessionState
