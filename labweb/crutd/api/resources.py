"""REST of resources."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any, ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.answers import NamedRef
from labweb.common.clock import now
from labweb.common.lists import HISTORY, STANDING
from labweb.common.requests import Parameter, moment
from labweb.crutd import selectors
from labweb.crutd.answers import (
    ContentRow,
    EventList,
    FieldOrigin,
    ResourceDetail,
    ResourceKeeper,
    ResourceList,
    ResourcePort,
    ResourceRow,
    SeenConnection,
)
from labweb.crutd.api.events import event_rows
from labweb.crutd.api.holds import keepers_of
from labweb.crutd.selectors.data_origin import told_of
from labweb.crutd.selectors.history_replay import Past, as_it_was
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd.ledger import Amount
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.resources.resource_kinds import KINDS, Nature, is_vessel
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources import selectors as resource_selectors
from labweb.resources.api import connection_end
from labweb.resources.selectors import Connection, Lab, Lot, Resource

AT = Parameter(
    {"type": "string", "format": "date-time"},
    "Show the lab as it was at this time, ISO 8601 with its zone. A time to come is "
    "refused with `time.future`, one before the import with `time.before_lab`.",
)


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
