"""What the endpoints of resources, events, stock-taking and tickets answer with."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal
from uuid import UUID

from msgspec import UNSET, UnsetType

from labweb.common.answers import ApiAnswer, NamedRef, NumberedRef
from labweb.domain.crutd.operations import OperationName
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import Finding
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.resources.resource_kinds import Nature
from labweb.resources.answers import ConnectionEnd


class ContentRow(ApiAnswer):
    """How much of one lot a vessel holds."""

    lot_id: UUID
    lot: str
    """Its number, or its key where it has none."""

    material: str
    amount_nl: int
    """Nanolitres of a liquid; otherwise zero."""

    amount_ug: int
    """Micrograms of a solid or a gas; otherwise zero."""


class ResourceKeeper(ApiAnswer):
    """A run that keeps a resource for itself."""

    run_id: UUID
    run: int
    """Number of the run."""

    until_step: int
    is_shared: bool
    """Others may draw from it, or pour into it, too."""


class ResourceRow(ApiAnswer, kw_only=True):
    """One resource of the tree with its contents."""

    id: UUID
    key: str
    parent_id: UUID | None
    """Null: the root."""

    name: str
    kind: str
    kind_label: str
    nature: Nature
    depth: int
    """How many resources are above it."""

    holds_liquid: bool
    contents: list[ContentRow]
    volume_nl: int
    capacity_nl: int | None
    """Null: nobody stated it."""

    is_quarantined: bool
    is_archived: bool
    device: NamedRef | None
    pose: dict[str, Any] | None
    """Where it stands in its parent, as the lab file says it."""

    held_by: list[ResourceKeeper]
    """Several where they only draw from it; none of a time that is past."""


class ResourceList(ApiAnswer, kw_only=True):
    """A page of the tree."""

    at: datetime | UnsetType = UNSET
    """The moment that was asked for; absent: now."""

    resources: list[ResourceRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class SeenConnection(ApiAnswer):
    """All of a connection as it is shown; it is taken off only while it still is so."""

    connection_id: UUID
    key: str
    source_id: UUID
    source_port: str
    target_id: UUID
    target_port: str
    medium: Medium


class ResourcePort(ApiAnswer):
    """A port of a resource that something is connected to."""

    port: str
    to: ConnectionEnd
    medium: Medium
    connection: SeenConnection
    may_disconnect: bool


class FieldOrigin(ApiAnswer):
    """How the record came to know a field of a resource."""

    how: Literal["set", "measured", "unknown"]
    at: datetime
    job_id: UUID | None
    """Null: people did it, or a halt took it away."""


class EventSubjectRow(ApiAnswer):
    """A resource that an event concerns."""

    id: UUID
    name: str
    role: str


class DoubtEnd(ApiAnswer):
    """How a doubt that an event left was ended."""

    doubt_at: datetime
    at: datetime
    state: TransactionState
    by: str
    """Name of the person who answered; empty: nobody is known."""

    answer: str
    """Empty: no person gave one."""

    moved_nl: int | None
    note: str
    despite_reading: str
    text: str


class EventRow(ApiAnswer):
    """One act on matter, as the record has it."""

    seq: int
    at: datetime
    received_at: datetime
    uncertainty_s: float | None
    """At most so far is `at` wrong; null: the server timed it itself."""

    is_bounded: bool
    operation: OperationName
    state: TransactionState
    verification: str
    """How surely the outcome is known; empty: it has none yet."""

    subjects: list[EventSubjectRow]
    amount_nl: int | None
    amount_ug: int | None
    """Of what is moved by mass: a solid, or what goes along with a liquid."""

    summary: str
    job_id: UUID | None
    code: str
    message: str
    transaction_id: UUID
    resolved: DoubtEnd | None
    """How the doubt that it left was ended; null: it is open, or there was none."""

    run: NumberedRef | UnsetType | None = UNSET
    """Null: no run did it, or none that the caller may see; absent: a person did it just now."""


class EventList(ApiAnswer):
    """A page of events, the newest first."""

    events: list[EventRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class ResourceDetail(ResourceRow, kw_only=True):
    """One resource with what happened to it."""

    config: dict[str, Any]
    data: dict[str, Any]
    data_told: dict[str, FieldOrigin]
    """By field of `data`: how it is known, and since when."""

    extra: dict[str, Any]
    size_mm: list[float] | None
    """Length, width and height; null: nobody stated them."""

    ports: list[ResourcePort]
    events: list[EventRow]
    events_next: str | None


class OperationFindings(ApiAnswer):
    """What speaks against an operation; nothing: it may be carried out."""

    findings: list[Finding]


class LineageNode(ApiAnswer, kw_only=True):
    """A vessel, a delivery or an act in a lineage."""

    id: str
    """Of a delivery `lot:` and the id of the lot, otherwise an id alone."""

    kind: Literal["entity", "activity"]
    type: Literal["vessel", "lot", "job"]
    name: str
    detail: str
    at: str | None
    """Null: it has no time of its own."""

    job_id: UUID | UnsetType | None = UNSET
    """Of an act; null: a person did it."""


class LineageEdge(ApiAnswer):
    """What flowed from one node of a lineage to another."""

    source: str
    target: str
    amount_nl: int
    amount_ug: int
    at: str
    label: str


class LineageGraph(ApiAnswer):
    """Where what is in a vessel came from, and where it went."""

    root: UUID
    nodes: list[LineageNode]
    edges: list[LineageEdge]
    truncated: int
    """How many flows lie beyond what was walked."""

    unread: list[UUID]
    """Vessels whose history was too long to be read."""


class StockLot(ApiAnswer):
    """A lot that a vessel could hold."""

    lot_id: UUID
    lot: str
    material: str
    unit: Literal["nl", "ug"]
    """Liquids are counted in nanolitres, solids and gases in micrograms."""


class StockTaking(ApiAnswer):
    """Whether one may take stock of a resource, and which lots it could hold."""

    is_allowed: bool
    why_not: str | None
    lots: list[StockLot]


class ReactionLot(StockLot):
    """A lot in a vessel in which something may have reacted."""

    amount: int
    density_mg_ul: float | None


class ReactionMaterial(ApiAnswer):
    """A material that a product may be of."""

    id: UUID
    name: str
    density_mg_ul: float | None


class ReactionStock(ApiAnswer):
    """What a vessel holds, and of which materials a product may be."""

    is_allowed: bool
    lots: list[ReactionLot]
    materials: list[ReactionMaterial]


class TicketResource(ApiAnswer):
    """A resource that a ticket concerns."""

    id: UUID
    name: str
    is_quarantined: bool


class TicketDetail(ApiAnswer):
    """One contradiction between record and world."""

    id: UUID
    code: str
    message: str
    detail: dict[str, Any]
    resources: list[TicketResource]
    host: NamedRef | None
    opened_at: datetime
    closed_at: datetime | None
    """Null: it is open."""

    closed_by: str | None
    can_close: bool
