"""Reads of lots and materials."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from uuid import UUID

from django.db.models import Q, QuerySet, UUIDField

from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.crutd.operations import Product, Receive
from labweb.resources.models import Lab, Lot, Material


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
