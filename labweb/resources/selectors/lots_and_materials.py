"""Reads of lots and materials."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from uuid import UUID

from django.db.models import Q, QuerySet, UUIDField

from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.crutd.operations import Product, Receive
from labweb.resources.models import Connection as Connection
from labweb.resources.models import Lab as Lab
from labweb.resources.models import Lot as Lot
from labweb.resources.models import Material as Material
from labweb.resources.models import Resource as Resource
from labweb.resources.selectors.access import Reach as Reach
from labweb.resources.selectors.access import allowed_ids as allowed_ids
from labweb.resources.selectors.access import allowed_of as allowed_of
from labweb.resources.selectors.access import asking_allowed as asking_allowed
from labweb.resources.selectors.access import reach_of as reach_of
from labweb.resources.selectors.access import require as require
from labweb.resources.selectors.access import require_seen as require_seen
from labweb.resources.selectors.ancestry import Above as Above
from labweb.resources.selectors.ancestry import ancestors as ancestors
from labweb.resources.selectors.ancestry import ancestors_and_archived as ancestors_and_archived
from labweb.resources.selectors.ancestry import asking_hold as asking_hold
from labweb.resources.selectors.ancestry import descendants as descendants
from labweb.resources.selectors.ancestry import held_of as held_of
from labweb.resources.selectors.ancestry import hold as hold


def lots_of(lab: Lab) -> QuerySet[Lot]:
    """Every lot of a lab, with its material."""
    return Lot.objects.filter(lab=lab).select_related("material")


LOTS = Prepared(
    lambda: Lot.objects.filter(lab_id=Given("lab", UUIDField())).select_related("material")
)
"""Every lot of a lab, with its material."""


def find_lots(ids: Iterable[str]) -> QuerySet[Lot]:
    """The lots with these ids, with their materials."""
    return Lot.objects.filter(pk__in=list(ids)).select_related("material")


def materials_of(lab: Lab) -> QuerySet[Material]:
    """Every material of a lab."""
    return Material.objects.filter(lab=lab)


MATERIALS = Prepared(lambda: Material.objects.filter(lab_id=Given("lab", UUIDField())))
"""Every material of a lab."""


def find_material(material_id: UUID) -> Material | None:
    """Return a material, or None."""
    return Material.objects.filter(pk=material_id).first()


def is_known_delivery(lab: Lab, receive: Receive) -> bool:
    """Tell whether a lot of this id or key was received, or of this supplier and number."""
    same = Q(pk=receive.lot_id) | Q(lab=lab, key=receive.key)
    if receive.number:
        same |= Q(material_id=receive.material_id, supplier=receive.supplier, number=receive.number)
    return Lot.objects.filter(same).exists()


def taken_lots(lab: Lab, products: Sequence[Product]) -> frozenset[UUID]:
    """Return the ids of those products of which a lot has the id, or in the lab the key."""
    ids, keys = [one.lot_id for one in products], [one.key for one in products]
    rows = Lot.objects.filter(Q(pk__in=ids) | Q(lab=lab, key__in=keys)).values_list("pk", "key")
    found = set(rows)
    return frozenset(
        one.lot_id
        for one in products
        if any(one.lot_id == pk or one.key == key for pk, key in found)
    )
