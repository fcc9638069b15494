"""What the endpoints of devices answer with."""

from __future__ import annotations

from typing import Any, Literal
from uuid import UUID

from labweb.common.answers import ApiAnswer, NamedRef
from labweb.domain.runs.states.job_states import JobState
from labweb.fleet.answers.drivers import DriverProblem, DriverServing, NextDriver
from labweb.runs.answers.runs import DeviceHaltRow
from labweb.telemetry.answers import PhotoRow
from labweb.workflows.answers import DeviceAction

DeviceLink = Literal["online", "stale", "offline", "not_enrolled", "quarantined"]


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
