"""What the endpoints of devices and hosts answer with."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal
from uuid import UUID

from labweb.api.answers.drivers import DriverProblem, DriverServing, NextDriver
from labweb.common.answers import ApiAnswer, NamedRef
from labweb.domain.runs.exclusive_use.resource_custody import CustodyState
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import JobState
from labweb.runs.answers.runs import DeviceHaltRow
from labweb.telemetry.answers import PhotoRow
from labweb.workflows.answers import DeviceAction

DeviceLink = Literal["online", "stale", "offline", "not_enrolled", "quarantined"]
DiskLevel = Literal["ok", "low", "full"]


class DeviceJob(ApiAnswer):
    """The job that acts on a device."""

    id: UUID
    run_id: UUID
    run_number: int
    sentence: str
    state: JobState


class DeviceStatus(ApiAnswer):
    """One thing that a device tells."""

    name: str
    label: str
    unit: str
    """As a person reads it; empty: it has none."""

    doc: str


class DeviceReading(DeviceStatus):
    """What a device told last of one status."""

    status: str
    """The same as `name`."""

    value: float | str | bool | None
    at_s: float
    """Seconds since the Unix epoch."""


class DeviceRow(ApiAnswer):
    """One device in a list."""

    id: UUID
    key: str
    name: str
    role: str
    kind_label: str
    host: NamedRef
    state: str
    link: DeviceLink
    is_halt_owed: bool
    """Nothing begins on it before its host has halted it."""

    halt: DeviceHaltRow | None
    """The halt that was asked for last and is not delivered; of one device alone, the last one."""

    job: DeviceJob | None
    readings: list[DeviceReading]


class DeviceList(ApiAnswer):
    """A page of devices."""

    devices: list[DeviceRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class DeviceDriverUse(ApiAnswer):
    """The driver of a device, and what became of its versions."""

    class_name: str
    digest: str
    protocol: str
    quality: str
    doc: str
    version_id: UUID
    next: NextDriver | None
    problem: DriverProblem | None
    serving: DriverServing | None


class DevicePart(ApiAnswer):
    """A resource that is a part of a device."""

    role: str
    id: UUID
    name: str


class DeviceDetail(DeviceRow):
    """One device whole."""

    driver: DeviceDriverUse
    actions: list[DeviceAction]
    shows_itself: bool
    """It can show which one it is, on a display or by a light."""

    statuses: list[DeviceStatus]
    config: dict[str, Any]
    """Settings of its driver."""

    nodes: list[DevicePart]
    """Those that the caller may see."""

    transport: str
    photo: PhotoRow | None


class ShowingRun(ApiAnswer):
    """The run in which a device shows its name."""

    run_id: UUID
    number: int


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
