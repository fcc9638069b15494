"""What stands in which place."""

from __future__ import annotations

from collections.abc import Collection
from uuid import UUID

from labweb.domain.resources.places import Place, Thing, is_bounded, sites_of
from labweb.resources.models import Resource


def places_of(ids: Collection[UUID]) -> dict[UUID, Place]:
    """Return places with what stands in them, where that has a say; two queries.

    Whoever brings something has locked the rows of its place before.
    """
    rows = Resource.objects.filter(pk__in=list(ids)).order_by("pk")
    things: dict[UUID, list[Thing]] = {}
    below = Resource.objects.filter(parent_id__in=list(ids), is_archived=False)
    for one in below.order_by("position", "key"):
        if one.parent_id is not None:
            things.setdefault(one.parent_id, []).append(Thing(one.id, one.name, one.kind))
    return {
        row.id: Place(
            thing=Thing(row.id, row.name, row.kind),
            there=tuple(things.get(row.id, ())) if is_bounded(row.kind) else (),
            sites_count=sites_of(row.config),
        )
        for row in rows
    }
