"""REST of resources with their contents, and of events."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request
from rest_framework.response import Response

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.common.answers import ApiAnswer, NamedRef
from labweb.common.clock import now
from labweb.common.lists import HISTORY, STANDING
from labweb.common.requests import Parameter, body, moment, one_of, whole_number, word
from labweb.crutd import selectors, services
from labweb.crutd.answers import (
    ContentRow,
    EventList,
    EventRow,
    FieldOrigin,
    LineageGraph,
    OperationFindings,
    ResourceDetail,
    ResourceKeeper,
    ResourceList,
    ResourcePort,
    ResourceRow,
    SeenConnection,
)
from labweb.crutd.api.events import event_rows as event_rows
from labweb.crutd.api.holds import keepers_of
from labweb.crutd.selectors import lineage
from labweb.crutd.selectors.archived import with_former_place
from labweb.crutd.selectors.past import Past, as_it_was
from labweb.crutd.selectors.told import told_of
from labweb.domain.approvals.roles import Permission
from labweb.domain.crutd import operations
from labweb.domain.crutd.ledger import Amount
from labweb.domain.errors import DefinitionError, Finding
from labweb.domain.graph.topology import Medium
from labweb.domain.resources.contents import LotId
from labweb.domain.resources.kinds import KINDS, Nature, is_vessel
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources import selectors as resource_selectors
from labweb.resources.api import connection_end
from labweb.resources.selectors import Connection, Lab, Lot, Resource

AT = Parameter(
    {"type": "string", "format": "date-time"},
    "Show the lab as it was at this time, ISO 8601 with its zone. A time to come is "
    "refused with `time.future`, one before the import with `time.before_lab`.",
)
_DIRECTIONS = ("both", "up", "down")
_ELSEWHERE = "elsewhere"
"""Stands for the name of what the caller may not know of."""


def visible(request: Request, resource_id: UUID) -> Resource:
    """Return a resource the caller may see.

    Raises:
        NotFoundError: There is none, or none the caller may know of.
    """
    resource_selectors.require_seen(user_of(request), [resource_id])
    return resource_selectors.find_resource(resource_id)


class Resources(Endpoint):
    """The tree."""

    queries: ClassVar[Mapping[str, Parameter]] = {"at": AT, **STANDING.parameters}

    def get(self, request: Request) -> ResourceList:
        """List the resources the caller may see, in tree order; `at` shows them as they were."""
        lab = resource_selectors.the_lab()
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        at = moment(request, "at")
        if at is not None:
            past = as_it_was(lab, at, now=now())
            shown, following = _page(request, [row for row in past.rows if row.id in seen])
            told = past_rows(lab, replace(past, rows=shown), seen)
            return ResourceList(at=at, resources=told, next=following)
        rows = [row for row in resource_selectors.resources_of(lab) if row.id in seen]
        shown, following = _page(request, rows)
        return ResourceList(resources=resource_rows(lab, shown), next=following)


def _page(request: Request, rows: Collection[Resource]) -> tuple[list[Resource], str | None]:
    """Cut a page out of a tree, in tree order: each row stands behind all of its path."""
    by_id = {row.id: row for row in rows}
    paths: dict[UUID, list[Any]] = {}

    def path(row: Resource) -> list[Any]:
        if row.id not in paths:
            above = by_id.get(row.parent_id) if row.parent_id else None
            here = [row.position, row.key, row.id.hex]
            paths[row.id] = here if above is None else [*path(above), *here]
        return paths[row.id]

    return STANDING.of_list(request, rows, path)


class OneResource(Endpoint):
    """One resource; `labweb.records.api.resource_history` names the runs of its events."""

    def get(self, request: Request, resource_id: UUID) -> ResourceDetail:
        """Return a resource with what happened to it."""
        row = visible(request, resource_id)
        lab = resource_selectors.the_lab()
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        mine = resource_selectors.allowed_ids(user_of(request), Permission.ADMIT)
        ends = resource_selectors.connections_at(lab, [row.id])
        ports = [
            _port(row, edge, may_disconnect={edge.source_id, edge.target_id} <= mine)
            for edge in ends
            if {edge.source_id, edge.target_id} <= seen
        ]
        rows = selectors.events_of(lab, resource_id=row.id)
        events, following = HISTORY.of_rows(request, rows, "-seq")
        return ResourceDetail(
            **msgspec.structs.asdict(resource_rows(lab, [row])[0]),
            config=row.config,
            data=row.data,
            data_told=msgspec.convert(told_of(row), dict[str, FieldOrigin]),
            extra=row.extra,
            size_mm=row.size_mm,
            ports=ports,
            events=event_rows(events, seen),
            events_next=following,
        )


def _port(row: Resource, edge: Connection, *, may_disconnect: bool) -> ResourcePort:
    is_source = edge.source_id == row.id
    medium = Medium(edge.medium)
    return ResourcePort(
        port=edge.source_port if is_source else edge.target_port,
        to=connection_end(edge.target, edge.target_port)
        if is_source
        else connection_end(edge.source, edge.source_port),
        medium=medium,
        connection=SeenConnection(
            connection_id=edge.id,
            key=edge.key,
            source_id=edge.source_id,
            source_port=edge.source_port,
            target_id=edge.target_id,
            target_port=edge.target_port,
            medium=medium,
        ),
        may_disconnect=may_disconnect,
    )


class ResourceEvents(Endpoint):
    """What happened to one resource; the floor above names the runs."""

    queries = HISTORY.parameters

    def get(self, request: Request, resource_id: UUID) -> EventList:
        """List its events, newest first; the `events_next` of the resource goes on here."""
        row = visible(request, resource_id)
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        rows = selectors.events_of(resource_selectors.the_lab(), resource_id=row.id)
        events, following = HISTORY.of_rows(request, rows, "-seq")
        return EventList(events=event_rows(events, seen), next=following)


class Act(msgspec.Struct, forbid_unknown_fields=True):
    """What a person did or is about to do by hand."""

    operation: operations.HandOperation
    note: Annotated[str, msgspec.Meta(max_length=2000)] = ""


class HandOperations(Endpoint):
    """Operations that people carry out by hand and tell of.

    A transfer between two edge hosts does not end here: `labweb.runs.api.custody` takes it.
    """

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Act}
    answers: ClassVar[Mapping[str, Mapping[int, type[ApiAnswer]]]] = {"post": {201: EventRow}}

    def post(self, request: Request) -> Response:
        """Check an operation under locks and write it down as done: all of it, or nothing."""
        act = body(request, Act)
        user = user_of(request)
        require_act(user, act.operation)
        row = self.carry_out(act, user)
        return Response(event_rows([row.events.get()])[0], status=201)

    def carry_out(self, act: Act, user: User) -> selectors.Transaction:
        """Do it; the floor above asks more of some operations."""
        return services.carry_out(
            act.operation, lab=resource_selectors.the_lab(), actor_id=user.pk, note=act.note
        )


class OperationCheck(Endpoint):
    """What speaks against an operation."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Act}
    harmless: ClassVar[Mapping[str, str]] = {"post": "it calculates and writes nothing"}

    def post(self, request: Request) -> OperationFindings:
        """List every finding against an operation as things stand; change nothing."""
        act = body(request, Act)
        user = user_of(request)
        require_act(user, act.operation)
        return OperationFindings(findings=self.findings(act, user))

    def findings(self, act: Act, user: User) -> list[Finding]:
        """List them; the floor above asks more of some operations."""
        lab = resource_selectors.the_lab()
        return services.check_operation(act.operation, lab=lab, actor_id=user.pk)


def require_act(user: User, operation: operations.Operation) -> None:
    """Refuse who may not do this, or may not know of a resource it names."""
    if operations.is_told_by_server(operation):
        text = "the server itself writes down where a thing stood: leave from_id and pose out"
        raise DefinitionError(f"the request is not as described: {text}", code="http.body")
    wanted = Permission.RUN
    if isinstance(operation, operations.Correct):
        wanted = Permission.RESOLVE
    elif isinstance(operation, operations.Disconnect):
        wanted = Permission.ADMIT
    ids = set(operations.touched_ids(with_former_place(operation)))
    resource_selectors.require_seen(user, ids)
    resource_selectors.require(user, wanted, ids)


class Lineage(Endpoint):
    """Where what is in a vessel came from, and where it went."""

    queries: ClassVar[Mapping[str, Parameter]] = {
        "direction": one_of(_DIRECTIONS),
        "depth": Parameter({"type": "integer", "minimum": 1, "maximum": lineage.DEEPEST}),
    }

    def get(self, request: Request, resource_id: UUID) -> LineageGraph:
        """Return the graph around a vessel, `direction` up, down or both, to `depth`."""
        row = visible(request, resource_id)
        direction = word(request, "direction", _DIRECTIONS)
        depth = whole_number(request, "depth", default=3, low=1, high=lineage.DEEPEST)
        told = lineage.lineage(row, direction=direction, depth=depth)
        graph = msgspec.convert(told, LineageGraph)
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        for node in graph.nodes:
            if node.type == "vessel" and UUID(node.id) not in seen:
                node.name, node.detail = _ELSEWHERE, ""
        graph.unread = [one for one in graph.unread if one in seen]
        return graph


def resource_rows(lab: Lab, rows: Iterable[Resource]) -> list[ResourceRow]:
    """Return tree rows with contents and depth; a fixed number of queries."""
    nodes = list(rows)
    held = selectors.amounts(row.id for row in nodes)
    above = resource_selectors.ancestors(row.id for row in nodes)
    lots = {str(lot.id): lot for lot in resource_selectors.lots_of(lab)}
    devices = _devices(lab)
    keepers = keepers_of(row.id for row in nodes)
    return [
        _row(row, held.get(row.id, {}), len(above[row.id]), lots, devices, keepers.get(row.id, []))
        for row in nodes
    ]


def past_rows(lab: Lab, past: Past, seen: Collection[UUID]) -> list[ResourceRow]:
    """Return a lab at one moment as `resource_rows` does now; devices are those of today."""
    lots = {str(lot.id): lot for lot in resource_selectors.lots_of(lab)}
    devices = _devices(lab)
    return [
        _row(row, past.contents.get(row.id, {}), past.depths[row.id], lots, devices, [])
        for row in past.rows
        if row.id in seen
    ]


def _devices(lab: Lab) -> dict[str, Any]:
    return {
        node: device
        for device in enrollment_selectors.present_devices(lab)
        for node in device.nodes.values()
    }


def _row(
    row: Resource,
    held: Mapping[LotId, Amount],
    depth: int,
    lots: Mapping[str, Lot],
    devices: Mapping[str, Any],
    keepers: list[ResourceKeeper],
) -> ResourceRow:
    kind = KINDS.get(row.kind)
    device = devices.get(str(row.id))
    return ResourceRow(
        id=row.id,
        key=row.key,
        parent_id=row.parent_id,
        name=row.name,
        kind=row.kind,
        kind_label=row.kind if kind is None else kind.label,
        nature=Nature(row.nature),
        depth=depth,
        holds_liquid=is_vessel(row.kind),
        contents=[
            ContentRow(
                lot_id=lots[lot_id].id,
                lot=lots[lot_id].number or lots[lot_id].key,
                material=lots[lot_id].material.name,
                amount_nl=amount.nl,
                amount_ug=amount.ug,
            )
            for lot_id, amount in sorted(held.items(), key=lambda item: (-item[1].nl, -item[1].ug))
        ],
        volume_nl=sum(amount.nl for amount in held.values()),
        capacity_nl=selectors.capacity_nl_of(row),
        is_quarantined=row.quarantined_by is not None,
        is_archived=row.is_archived,
        device=None if device is None else NamedRef(id=device.id, name=device.name),
        pose=row.pose,
        held_by=keepers,
    )
