"""Reads of the physical graph: connections and what is attached."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any
from uuid import UUID

from django.db.models import Q, QuerySet, UUIDField

from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.crutd.operations import Refit
from labweb.domain.graph.attachments import Attachment, find_attachments
from labweb.domain.graph.ports_and_connections import Connection as ConnectionData
from labweb.domain.graph.ports_and_connections import Medium, PhysicalGraph, PortRef
from labweb.resources.models import Connection, Lab
from labweb.resources.selectors.ancestry import (
    descendants,
)


def taken_tubes(lab: Lab, refit: Refit) -> tuple[str, ...]:
    """Return the keys of tubes that come which connections have that stay, sorted."""
    if not refit.joined:
        return ()
    there = Connection.objects.filter(lab=lab, key__in=[joint.key for joint in refit.joined])
    return tuple(sorted(there.exclude(pk__in=refit.parted).values_list("key", flat=True)))


def connections_of(lab: Lab) -> QuerySet[Connection]:
    """Every connection of a lab."""
    return Connection.objects.filter(lab=lab)


def connections_at(lab: Lab, ids: Collection[UUID]) -> QuerySet[Connection]:
    """Return the connections that begin or end at one of the resources, with both ends."""
    rows = Connection.objects.filter(lab=lab).select_related("source", "target")
    return rows.filter(Q(source_id__in=list(ids)) | Q(target_id__in=list(ids)))


def graph_of(lab: Lab) -> PhysicalGraph:
    """Return the physical graph of a lab."""
    return to_graph(CONNECTIONS.rows(lab=lab.pk))


CONNECTIONS = Prepared(lambda: Connection.objects.filter(lab_id=Given("lab", UUIDField())))
"""Every connection of a lab."""


def to_graph(rows: Iterable[Connection]) -> PhysicalGraph:
    """Turn all the connections of a lab into what routing works on."""
    return PhysicalGraph(tuple(_to_connection(row) for row in rows))


def _to_connection(row: Connection) -> ConnectionData:
    return ConnectionData(
        id=row.id,
        key=row.key,
        source=PortRef(row.source_id, row.source_port),
        target=PortRef(row.target_id, row.target_port),
        medium=Medium(row.medium),
        is_two_way=row.is_two_way,
        dead_volume_nl=row.dead_volume_nl,
        extra=row.extra,
    )


def attachments_of(resource_id: UUID) -> tuple[Attachment, ...]:
    """Return what connects a resource, or what stands in it, with the rest; two queries."""
    carried = descendants([resource_id])
    rows = Connection.objects.filter(Q(source__in=carried) | Q(target__in=carried))
    return find_attachments((_to_connection(row) for row in rows), carried)


def between(one_id: UUID, other_id: UUID) -> QuerySet[Connection]:
    """Return the connections between two nodes, drawn either way."""
    forth = Q(source_id=one_id, target_id=other_id)
    return Connection.objects.filter(forth | Q(source_id=other_id, target_id=one_id))


def hanging(refit: Refit, gone: Collection[UUID]) -> tuple[Attachment, ...]:
    """Return what leads into parts that go, or to ports that go, and would lead nowhere.

    Args:
        refit: What is to be; the tubes that go with it are none of these.
        gone: The parts that go, with all that stands in them.
    """
    counts = {one: config.get("ports_count") for one, config in refit.configs.items()}
    ids = {*gone, *counts}
    rows = Connection.objects.filter(Q(source__in=ids) | Q(target__in=ids))
    found = []
    for one in (_to_connection(row) for row in rows.exclude(pk__in=refit.parted)):
        lost = [end for end in (one.source, one.target) if _is_lost(end, gone, counts)]
        if len(lost) == 1 or any(end.resource_id not in gone for end in lost):
            other = one.target if lost[0] is one.source else one.source
            found.append(Attachment(key=one.key, medium=one.medium, own=lost[0], other=other))
    return tuple(sorted(found, key=lambda one: (one.key, one.own)))


def _is_lost(end: PortRef, gone: Collection[UUID], counts: Mapping[UUID, Any]) -> bool:
    count = counts.get(end.resource_id)
    beyond = isinstance(count, int) and end.port.isdecimal() and int(end.port) > count
    return beyond or end.resource_id in gone
