"""Reads of the resource tree."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from uuid import UUID

from django.db.models import Q, QuerySet, UUIDField

from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.errors import NotFoundError
from labweb.domain.resources.pose import parse_pose
from labweb.domain.resources.resource import Resource as ResourceData
from labweb.domain.resources.resource_kinds import Nature
from labweb.domain.resources.resource_tree import Tree
from labweb.resources.models import Lab, Resource


def rows(ids: Iterable[UUID]) -> QuerySet[Resource]:
    """The nodes with these ids, in id order."""
    return Resource.objects.filter(pk__in=list(ids)).order_by("pk")


def resources_of(lab: Lab) -> QuerySet[Resource]:
    """Every node of a lab, parents' order kept."""
    return Resource.objects.filter(lab=lab)


NODES = Prepared(lambda: Resource.objects.filter(lab_id=Given("lab", UUIDField())))
"""Every node of a lab, parents' order kept."""


def find_by_key(lab: Lab, key: str) -> Resource:
    """Return the node of a lab that has this key.

    Raises:
        NotFoundError: There is none.
    """
    found = Resource.objects.filter(lab=lab, key=key).first()
    if found is None:
        raise NotFoundError(f"no resource has the key {key!r}", code="resource.not_found")
    return found


def ids_by_key(lab: Lab, keys: Collection[str]) -> dict[str, UUID]:
    """Return the ids of a lab's nodes by those of the keys that it has."""
    return dict(Resource.objects.filter(lab=lab, key__in=keys).values_list("key", "id"))


def taken_keys(lab: Lab, keys: Collection[str]) -> list[str]:
    """Return those of the keys that a lab has already, sorted."""
    found = Resource.objects.filter(lab=lab, key__in=keys)
    return sorted(found.values_list("key", flat=True))


def find_resource(resource_id: UUID) -> Resource:
    """Return one node.

    Raises:
        NotFoundError: There is none.
    """
    found = Resource.objects.filter(pk=resource_id).select_related("lab").first()
    if found is None:
        raise NotFoundError(f"no resource {resource_id}", code="resource.not_found")
    return found


def to_domain(row: Resource) -> ResourceData:
    """Turn a row into what the rules work on."""
    size = row.size_mm
    return ResourceData(
        id=row.id,
        key=row.key,
        name=row.name,
        kind=row.kind,
        nature=Nature(row.nature),
        parent_id=row.parent_id,
        pose=parse_pose(row.pose),
        size_mm=None if size is None else (size[0], size[1], size[2]),
        config=row.config,
        data=row.data,
        extra=row.extra,
    )


def tree_of(rows: Iterable[Resource]) -> Tree:
    """Return the tree of all the nodes of a lab, for planning and export."""
    return Tree(tuple(to_domain(row) for row in rows))


def archive_of(lab: Lab) -> Resource | None:
    """Return the Archive of a lab, the first in the file's order; None: it has none."""
    return Resource.objects.filter(lab=lab, kind="archive", is_archived=False).first()


def rows_for_update(ids: Collection[UUID]) -> dict[UUID, Resource]:
    """Lock the rows in id order, waiting for who has them, and return them."""
    return {row.id: row for row in rows(ids).select_for_update(no_key=True)}


def quarantined_by(transaction_id: UUID) -> list[UUID]:
    """Return what a transaction closed and nobody has opened since."""
    closed = Resource.objects.filter(quarantined_by=transaction_id)
    return list(closed.values_list("pk", flat=True))


def root_of(lab: Lab) -> Resource:
    """Return the root of a lab's tree."""
    return Resource.objects.get(lab=lab, parent__isnull=True)


def names(ids: Iterable[UUID]) -> dict[UUID, str]:
    """Return name by id."""
    return dict(rows(ids).values_list("id", "name"))


def names_in(*values: Iterable[object]) -> dict[str, str]:
    """Return name by reference of the resources whose ids are among values, as texts."""
    told = {one for some in values for one in some if isinstance(one, str)}
    return {str(one): name for one, name in names(map(UUID, filter(_is_id, told))).items()}


def _is_id(text: str) -> bool:
    try:
        return str(UUID(text)) == text
    except ValueError:
        return False


def is_taken(lab: Lab, resource_id: UUID, key: str) -> bool:
    """Tell whether a resource of this id, or of this key in the lab, is there already."""
    return Resource.objects.filter(Q(pk=resource_id) | Q(lab=lab, key=key)).exists()
