"""Writes of the tree. Called by `crutd` alone, which owns the one write path."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any
from uuid import UUID

from django.db import connection
from django.db.models import F

from labweb.common.clock import now
from labweb.domain.crutd.operations import Create, Receive
from labweb.domain.errors import StateError
from labweb.domain.resources.kinds import KINDS
from labweb.resources.models import Connection, Lab, Lot, Material, Resource

_LAB_LOCK = 0x6C61_6231
"""PostgreSQL advisory lock of who imports the lab."""


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


def create_rows(
    resources: Collection[Resource],
    connections: Collection[Connection],
    materials: Collection[Material],
    lots: Collection[Lot],
) -> None:
    """Write the rows of an import in bulk, parents first."""
    Resource.objects.bulk_create(resources)
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


def update_data(resource_id: UUID, data: Mapping[str, Any]) -> None:
    """Merge fields into `data`."""
    row = Resource.objects.get(pk=resource_id)
    row.data = {**row.data, **data}
    row.save(update_fields=["data"])


def move(resource_id: UUID, parent_id: UUID) -> None:
    """Give a node another parent: one row. Its pose there is unknown."""
    Resource.objects.filter(pk=resource_id).update(parent_id=parent_id, pose=None)


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


def release(ids: Collection[UUID]) -> None:
    """Open what was quarantined."""
    Resource.objects.filter(pk__in=ids).update(quarantined_by=None)


def raise_revs(ids: Collection[UUID]) -> None:
    """Count one settled change of each node."""
    Resource.objects.filter(pk__in=ids).update(rev=F("rev") + 1)


def set_revs(revs: Mapping[UUID, int]) -> None:
    """Take over the counters that the edge reported."""
    for resource_id, rev in revs.items():
        Resource.objects.filter(pk=resource_id).update(rev=rev)


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
