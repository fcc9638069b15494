"""What the endpoints of drivers answer with."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal
from uuid import UUID

from labweb.common.answers import ApiAnswer, KeyedRef
from labweb.domain.enrollment.driver_source_diff import ModuleChange
from labweb.domain.enrollment.driver_tryout import Tried
from labweb.domain.errors import Finding
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.workflows.answers import DeviceAction

DriverOrigin = Literal["release", "upload"]
DriverState = Literal["proposed", "approved", "rejected", "withdrawn"]


class NextDriver(ApiAnswer):
    """The version that shall take over."""

    version_id: UUID
    digest: str
    is_ready: bool
    """Its host has it on its disk, and has built it once."""


class DriverProblem(ApiAnswer):
    """Why a host did not take the version that was wanted last."""

    digest: str
    code: str
    message: str
    at: str


class DriverServing(ApiAnswer):
    """What a host said last of which version serves a device; it may be that of before."""

    digest: str
    at: str
    host_id: UUID
    is_present: bool
    """It is the version that the device has."""


class DriverUse(ApiAnswer):
    """Which version a device has, which it is to have, and what went wrong last."""

    version_id: UUID
    digest: str
    class_name: str
    next: NextDriver | None
    problem: DriverProblem | None
    serving: DriverServing | None


class DriverRights(ApiAnswer):
    """What the caller may do with a version."""

    read: bool
    """Its source; who may not is given none."""

    decide: bool
    withdraw: bool


class DriverRow(ApiAnswer):
    """One version of a driver in a list."""

    id: UUID
    module: str
    class_name: str
    role: str
    digest: str
    origin: DriverOrigin
    state: DriverState
    note: str
    quality: str
    doc: str
    proposed_by: str | None
    proposed_at: datetime | None
    approved_by: str | None
    approved_at: datetime | None
    read_at: datetime
    devices: list[KeyedRef]
    """Those that have it, of those that the caller may see."""

    can: DriverRights


class DriverList(ApiAnswer):
    """A page of versions."""

    drivers: list[DriverRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class DriverStatus(ApiAnswer):
    """One thing that a driver tells."""

    name: str
    label: str
    doc: str
    unit: str
    """As a person reads it; empty: it has none."""


class KnownDriver(ApiAnswer):
    """The version of the very source that was read."""

    id: UUID
    state: DriverState


class DriverReading(ApiAnswer):
    """What driver source declares, before anybody proposes it."""

    module: str
    class_name: str
    digest: str
    known: KnownDriver | None
    roles: list[str]
    doc: str
    quality: str
    imports: list[str]
    protocol: str
    safe_state: str
    actions: list[DeviceAction]
    statuses: list[DriverStatus]
    config: dict[str, Any]
    """JSON Schema of its settings."""


class DriverVerdict(ApiAnswer):
    """What a second person said about a version."""

    is_approved: bool
    printed_name: str
    comment: str
    at: datetime


class DriverRequest(ApiAnswer):
    """The request to approve a version."""

    id: UUID
    state: str
    asked_at: datetime
    expires_at: datetime
    decision: DriverVerdict | None


class DriverHost(ApiAnswer):
    """The host of a device that has a version."""

    id: UUID
    name: str
    state: SessionState


class DriverJob(ApiAnswer):
    """The job that acts on a device that has a version."""

    id: UUID
    run_id: UUID
    run_number: int
    sentence: str


class DriverPlace(ApiAnswer):
    """A device that has a version of a driver, or is to have it."""

    id: UUID
    key: str
    name: str
    state: str
    host: DriverHost
    driver: DriverUse
    job: DriverJob | None
    can_change: bool


class DriverDetail(DriverRow):
    """One version of a driver whole."""

    sources: dict[str, str]
    """Text by dotted name; empty: the caller may not read it."""

    roles: list[str]
    imports: list[str]
    protocol: str
    safe_state: str
    actions: list[DeviceAction]
    statuses: list[DriverStatus]
    config: dict[str, Any]
    """JSON Schema of its settings."""

    request: DriverRequest | None
    places: list[DriverPlace]
    tried: Tried


class DriverComparison(ApiAnswer):
    """What differs between two versions, by module."""

    modules: list[ModuleChange]


class ChosenDriver(ApiAnswer):
    """A device, and the versions that it has and is to have now."""

    id: UUID
    driver: DriverUse


class ChosenDriverList(ApiAnswer):
    """The devices that were given a version."""

    devices: list[ChosenDriver]


class DriverPartChanges(ApiAnswer):
    """What a version makes of the parts of a device."""

    decision: str
    """Whoever was shown the changes hands it back with the choice."""

    changes: list[Finding]
    findings: list[Finding]
    """What speaks against them."""
