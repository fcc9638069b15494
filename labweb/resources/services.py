"""Writes of the tree. Called by `crutd` alone, which owns the one write path."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any
from uuid import UUID

import msgspec
from django.db import connection
from django.db.models import CharField, Value
from django.db.models.functions import Cast, Concat

from labweb.common.clock import now
from labweb.domain.crutd.operations import Create, Operation, React, Receive, Refit
from labweb.domain.errors import StateError
from labweb.domain.resources.resource import Resource as ResourceData
from labweb.domain.resources.resource_kinds import KINDS
from labweb.resources.models import Connection, Lab, Lot, Material, Resource

_LAB_LOCK = 0x6C61_6231
"""PostgreSQL advisory lock of who imports the lab."""


_COPY = """
COPY resources_resource (id, lab_id, parent_id, key, name, kind, nature, pose, size_mm, config,
    data, extra, rev, is_archived, position) FROM STDIN
"""

_MERGE = "UPDATE resources_resource SET data = data || %s::jsonb WHERE id = %s"

_RAISE_REVS = "UPDATE resources_resource SET rev = rev + 1 WHERE id = ANY(%s)"

_SET_REVS = """
UPDATE resources_resource AS r SET rev = told.rev
FROM unnest(%s::uuid[], %s::bigint[]) AS told(id, rev) WHERE r.id = told.id
"""


def create_lab(**fields: Any) -> Lab:  # noqa: ANN401 - column values
    """Write the lab of this server; imports at the same time wait for each other.

    Raises:
        StateError: The database holds a lab already: one server serves one lab, and which
            one a stop is meant for is never to be a question. Nothing was written.
    """
    with connection.cursor() as cursor:
        cursor.execute("SELECT pg_advisory_xact_lock(%s)", [_LAB_LOCK])
    other = Lab.objects.first()
    if other is not None:
        raise StateError(
            f"this database holds the lab {other.name!r}, and one server serves one lab: give the "
            "other lab a data directory of its own (make run LAB=FILE), or an empty DATABASE_URL",
            code="lab.exists_other",
            context={"lab": str(other.id), "name": other.name},
        )
    return Lab.objects.create(**fields)


def create_nodes(lab: Lab, nodes: Iterable[tuple[ResourceData, int]]) -> None:
    """Write nodes, each with its place among its siblings, by COPY: a lab may have 100 000.

    Raises:
        django.db.IntegrityError: An id or a key is taken. Nothing was written.
    """
    with connection.cursor() as cursor, cursor.copy(_COPY) as copy:
        for node, position in nodes:
            copy.write_row(
                (
                    node.id,
                    lab.id,
                    node.parent_id,
                    node.key,
                    node.name,
                    node.kind,
                    node.nature.value,
                    None if node.pose is None else json.dumps(node.pose.to_json()),
                    None if node.size_mm is None else json.dumps(node.size_mm),
                    _json(node.config),
                    _json(node.data),
                    _json(node.extra),
                    1,
                    False,
                    position,
                )
            )


def _json(value: Mapping[str, Any]) -> str:
    return json.dumps(dict(value)) if value else "{}"


def create_links(
    connections: Collection[Connection],
    materials: Collection[Material],
    lots: Collection[Lot],
) -> None:
    """Write what an import brings beside its nodes, in bulk."""
    Connection.objects.bulk_create(connections)
    Material.objects.bulk_create(materials)
    Lot.objects.bulk_create(lots)


def create_resource(create: Create, lab: Lab) -> None:
    """Write one new node; where it stands is unknown until somebody confirms it."""
    Resource.objects.create(
        id=create.resource_id,
        lab=lab,
        parent_id=create.parent_id,
        key=create.key,
        name=create.name,
        kind=create.kind,
        nature=KINDS[create.kind].nature.value,
        config=create.config,
    )


def set_size(resource_id: UUID, size_mm: Sequence[float] | None) -> None:
    """Say how large the box around a node is."""
    size = None if size_mm is None else list(size_mm)
    Resource.objects.filter(pk=resource_id).update(size_mm=size)


def create_lot(receive: Receive, lab: Lab) -> None:
    """Write one new lot."""
    Lot.objects.create(
        id=receive.lot_id,
        lab=lab,
        key=receive.key,
        material_id=receive.material_id,
        supplier=receive.supplier,
        number=receive.number,
        expires_on=receive.expires_on,
        purity=receive.purity,
        phase=receive.phase.value,
        position=Lot.objects.filter(lab=lab).count(),
    )


_REPLAYED = (
    "parent", "key", "name", "kind", "nature", "position", "config", "data", "pose", "rev",
    "quarantined_by", "is_archived",
)  # fmt: skip
"""Fields of a resource that events tell of."""

_LINKED = ("key", "source", "source_port", "target", "target_port", "medium")
"""The same of a connection."""


def rewrite(
    lab: Lab,
    nodes: Sequence[Resource],
    connections: Sequence[Connection],
    materials: Sequence[Material],
    lots: Sequence[Lot],
) -> None:
    """Write resources and connections as they are told, and what is gone of the rest.

    Args:
        lab: Where they are.
        nodes: Every resource, parents first.
        connections: Every connection; one that is not told is taken off.
        materials: What the import brought.
        lots: What the import brought.
    """
    missing = {row.pk for row in nodes} - set(
        Resource.objects.filter(lab=lab).values_list("pk", flat=True)
    )
    # A key may have gone to another node since: what is there gives its own up first.
    known = Resource.objects.filter(lab=lab)
    known.update(key=Concat(Value("rebuild "), Cast("pk", CharField())))
    Resource.objects.bulk_create([row for row in nodes if row.pk in missing])
    Resource.objects.bulk_update([row for row in nodes if row.pk not in missing], _REPLAYED)
    Material.objects.bulk_create(materials, ignore_conflicts=True)
    Lot.objects.bulk_create(lots, ignore_conflicts=True)
    Connection.objects.filter(lab=lab).exclude(pk__in=[row.pk for row in connections]).delete()
    Connection.objects.bulk_create(
        connections, update_conflicts=True, unique_fields=["id"], update_fields=_LINKED
    )


def rewrite_lots(operation: Operation, lab: Lab) -> None:
    """Write the lots that a delivery or a reaction brought, where they are gone."""
    if isinstance(operation, Receive) and not Lot.objects.filter(pk=operation.lot_id).exists():
        create_lot(operation, lab)
    if isinstance(operation, React):
        ids = [product.lot_id for product in operation.products]
        if Lot.objects.filter(pk__in=ids).count() < len(ids):
            create_products(operation, lab)


def create_products(react: React, lab: Lab) -> None:
    """Write the lots that a reaction made."""
    position = Lot.objects.filter(lab=lab).count()
    Lot.objects.bulk_create(
        Lot(
            id=product.lot_id,
            lab=lab,
            key=product.key,
            material_id=product.material_id,
            number=product.number,
            purity=product.purity,
            phase=product.phase.value,
            position=position + place,
        )
        for place, product in enumerate(react.products)
    )


def update_data(resource_id: UUID, data: Mapping[str, Any]) -> None:
    """Merge fields into `data`."""
    with connection.cursor() as cursor:
        cursor.execute(_MERGE, [json.dumps(dict(data)), resource_id])


def set_config(resource_id: UUID, config: Mapping[str, Any]) -> None:
    """Give a part of a device the configuration that its driver has for it now."""
    Resource.objects.filter(pk=resource_id).update(config=dict(config))


def part(ids: Collection[UUID]) -> None:
    """Take connections off."""
    Connection.objects.filter(pk__in=ids).delete()


def connection_of(lab: Lab, link: Mapping[str, Any]) -> Connection:
    """Return the row of a connection as its event tells it; not written yet."""
    return Connection(
        id=UUID(link["id"]),
        lab=lab,
        key=link["key"],
        source_id=UUID(link["source_id"]),
        source_port=link["source_port"],
        target_id=UUID(link["target_id"]),
        target_port=link["target_port"],
        medium=link["medium"],
        is_two_way=True,
    )


def rejoin(refit: Refit, lab: Lab) -> None:
    """Take off the tubes of the parts that went, and write those of the parts that came."""
    part(refit.parted)
    tubes = [connection_of(lab, msgspec.to_builtins(joint)) for joint in refit.joined]
    Connection.objects.bulk_create(tubes)


def move(resource_id: UUID, parent_id: UUID) -> None:
    """Give a node another parent: one row. Its pose there is unknown."""
    Resource.objects.filter(pk=resource_id).update(parent_id=parent_id, pose=None)


def set_pose(resource_id: UUID, pose: Mapping[str, Any]) -> None:
    """Say where a node stands against its parent."""
    Resource.objects.filter(pk=resource_id).update(pose=dict(pose))


def archive(ids: Collection[UUID]) -> None:
    """Take nodes out of service; nothing is erased."""
    Resource.objects.filter(pk__in=ids).update(is_archived=True)


def restore(ids: Collection[UUID]) -> None:
    """Put archived nodes back into service."""
    Resource.objects.filter(pk__in=ids).update(is_archived=False)


def quarantine(ids: Collection[UUID], transaction_id: UUID) -> None:
    """Close nodes to all use until a person has said what happened; the first cause stays."""
    rows = Resource.objects.filter(pk__in=ids, quarantined_by__isnull=True)
    rows.update(quarantined_by=transaction_id)


def close_for(ids: Collection[UUID], transaction_id: UUID) -> None:
    """Keep nodes closed that are quarantined, for this cause and no former one."""
    rows = Resource.objects.filter(pk__in=ids, quarantined_by__isnull=False)
    rows.update(quarantined_by=transaction_id)


def release(ids: Collection[UUID]) -> None:
    """Open what was quarantined."""
    Resource.objects.filter(pk__in=ids).update(quarantined_by=None)


def raise_revs(ids: Collection[UUID]) -> None:
    """Count one settled change of each node."""
    if not ids:
        return
    with connection.cursor() as cursor:
        cursor.execute(_RAISE_REVS, [sorted(ids)])


def set_revs(revs: Mapping[UUID, int]) -> None:
    """Take over the counters that the edge reported."""
    if not revs:
        return
    with connection.cursor() as cursor:
        cursor.execute(_SET_REVS, [list(revs), list(revs.values())])


def latch_stop(lab: Lab, *, stop_id: UUID, user_id: UUID) -> None:
    """Record a software stop; it holds until a person resets it."""
    lab.is_stopped = True
    lab.stop_id = stop_id
    lab.stopped_at = now()
    lab.stopped_by_id = user_id
    lab.save(update_fields=["is_stopped", "stop_id", "stopped_at", "stopped_by"])


def release_stop(lab: Lab) -> None:
    """Release the stop latch. Starts nothing."""
    lab.is_stopped = False
    lab.save(update_fields=["is_stopped"])
