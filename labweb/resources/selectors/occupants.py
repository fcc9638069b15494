"""What stands in which place."""

from __future__ import annotations

from collections.abc import Collection
from uuid import UUID

from django.db.models import QuerySet

from labweb.domain.resources.placement import Place, PlacedThing, is_bounded, sites_of
from labweb.resources.models import Lab, Resource


def places_of(ids: Collection[UUID]) -> dict[UUID, Place]:
    """Return places with what stands in them, where that has a say; two queries.

    Whoever brings something has locked the rows of its place before.
    """
    return _with_what_stands_there(Resource.objects.filter(pk__in=list(ids)).order_by("pk"))


def places_of_kinds(lab: Lab, kinds: Collection[str]) -> list[Place]:
    """Return the lab's places of some kinds with what stands in them; two queries."""
    rows = Resource.objects.filter(lab=lab, kind__in=list(kinds), is_archived=False)
    return list(_with_what_stands_there(rows).values())


def _with_what_stands_there(found: QuerySet[Resource]) -> dict[UUID, Place]:
    rows = list(found)
    ids = [row.pk for row in rows if is_bounded(row.kind)]
    things: dict[UUID, list[PlacedThing]] = {}
    below = Resource.objects.filter(parent_id__in=ids, is_archived=False)
    for one in below.order_by("position", "key"):
        if one.parent_id is not None:
            things.setdefault(one.parent_id, []).append(PlacedThing(one.id, one.name, one.kind))
    return {
        row.id: Place(
            thing=PlacedThing(row.id, row.name, row.kind),
            there=tuple(things.get(row.id, ())) if is_bounded(row.kind) else (),
            sites_count=sites_of(row.config),
        )
        for row in rows
    }
