"""What the endpoints of tryouts answer with."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal
from uuid import UUID

from msgspec import UNSET, UnsetType

from labweb.common.answers import ApiAnswer, NamedRef
from labweb.domain.enrollment.driver_tryout import Tried
from labweb.domain.messages.driver_tryouts import AskSort

TryoutState = Literal["starting", "running", "ended"]


class TryoutModel(ApiAnswer):
    """A simulated instrument on which a version can be tried."""

    model: str
    title: str
    carriers: list[str]
    settings: dict[str, Any]
    """JSON Schema, with labels and units."""


class TryoutHost(ApiAnswer):
    """A host that runs tryouts."""

    id: UUID
    name: str
    problem: str | None
    """Why it runs none although it was told to."""

    models: list[TryoutModel]


class TryoutRow(ApiAnswer):
    """One tryout in a list."""

    id: UUID
    host: NamedRef
    model: str
    title: str
    """Maker and model, as on the type plate."""

    speed: float
    """Simulated seconds per second."""

    state: TryoutState
    code: str
    """Why it ended, when that was a failure; else empty."""

    message: str
    begun_by: str
    begun_at: datetime
    ended_at: datetime | None


class TryoutList(ApiAnswer):
    """Where a version can be tried, and a page of what was tried of it."""

    hosts: list[TryoutHost]
    fastest: float
    """The highest speed."""

    tried: Tried
    tryouts: list[TryoutRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class TryoutActRow(ApiAnswer):
    """One wish of the author, and what became of it."""

    number: int
    sort: AskSort
    name: str
    args: dict[str, Any]
    asked_at: datetime
    answered_at: datetime | None
    code: str
    """Empty, once answered: it went well."""

    message: str
    effect: str
    data: dict[str, Any]
    """Of an action its report; of a reading, values or problems by status."""

    has_faults: bool
    """A fault was in force at some time while it was carried out."""


class TryoutBytes(ApiAnswer):
    """Bytes that crossed the line of a tryout."""

    n: int
    at_s: float
    """Seconds since the tryout began."""

    direction: Literal["in", "out"]
    """`in`: towards the instrument."""

    hex: str


class TryoutStatuses(ApiAnswer):
    """The last reading of a tryout; neither is there before the first one."""

    values: dict[str, Any] | UnsetType = UNSET
    problems: dict[str, str] | UnsetType = UNSET
    left_out_bytes: int | UnsetType = UNSET
    """How much was read, where that is too much to be kept."""


class TryoutDetail(TryoutRow):
    """One tryout whole."""

    driver_id: UUID
    settings: dict[str, Any]
    config: dict[str, Any]
    """Settings of the driver."""

    faults_offered: dict[str, dict[str, Any]]
    """JSON Schema of the options, by name."""

    faults: list[str]
    """Those in force now."""

    statuses: TryoutStatuses
    acts: list[TryoutActRow]
    wire: list[TryoutBytes]
    wire_left_out_count: int
