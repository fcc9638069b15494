"""Reads of the tree and the graph."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any
from uuid import UUID

from django.db.models import Q, QuerySet, UUIDField

from labweb.accounts import selectors as account_selectors
from labweb.accounts.selectors import User
from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.approvals.roles import Permission
from labweb.domain.crutd.operations import Product, Receive, Refit
from labweb.domain.errors import NotFoundError
from labweb.domain.graph.attached import Attachment, find_attachments
from labweb.domain.graph.topology import Connection as ConnectionData
from labweb.domain.graph.topology import Medium, PhysicalGraph, PortRef
from labweb.domain.resources.kinds import Nature
from labweb.domain.resources.node import Resource as ResourceData
from labweb.domain.resources.pose import parse_pose
from labweb.domain.resources.tree import Tree
from labweb.resources.models import Connection as Connection
from labweb.resources.models import Lab as Lab
from labweb.resources.models import Lot as Lot
from labweb.resources.models import Material as Material
from labweb.resources.models import Resource as Resource
from labweb.resources.selectors.climbing import Above as Above
from labweb.resources.selectors.climbing import ancestors as ancestors
from labweb.resources.selectors.climbing import ancestors_and_archived as ancestors_and_archived
from labweb.resources.selectors.climbing import asking_hold as asking_hold
from labweb.resources.selectors.climbing import descendants as descendants
from labweb.resources.selectors.climbing import held_of as held_of
from labweb.resources.selectors.climbing import hold as hold
from labweb.resources.selectors.reach import Reach as Reach
from labweb.resources.selectors.reach import allowed_ids as allowed_ids
from labweb.resources.selectors.reach import allowed_of as allowed_of
from labweb.resources.selectors.reach import asking_allowed as asking_allowed
from labweb.resources.selectors.reach import reach_of as reach_of
from labweb.resources.selectors.reach import require as require
from labweb.resources.selectors.reach import require_seen as require_seen

_MOST_LABS = 1000


def the_lab() -> Lab:
    """Return the lab this server runs: the only one, and of several the first imported.

    A second lab is refused; a database from before that rule may hold one, and the lab that
    ran first must stay the one that a stop is for.

    Raises:
        NotFoundError: None was imported yet.
    """
    labs = {str(lab.id): lab for lab in Lab.objects.order_by("id")[:_MOST_LABS]}
    if not labs:
        raise NotFoundError("no lab yet: import one with import_lab", code="lab.none")
    first = next(iter(labs))
    if len(labs) > 1:
        first = account_selectors.first_subject("lab.import", labs) or first
    return labs[first]


def lab_for_update(lab_id: UUID) -> Lab:
    """Lock and return a lab.

    Raises:
        NotFoundError: There is none.
    """
    return locked(LAB_TO_LOCK.rows(id=lab_id), lab_id)


def locked(rows: Sequence[Lab], lab_id: UUID) -> Lab:
    """Return the lab that `LAB_TO_LOCK` has found; raises as above."""
    if not rows:
        raise NotFoundError(f"no lab {lab_id}", code="lab.none")
    return rows[0]


LAB_TO_LOCK = Prepared(
    lambda: Lab.objects.filter(pk=Given("id", UUIDField())).select_for_update(
        of=("self",), no_key=True
    )
)


def rows(ids: Iterable[UUID]) -> QuerySet[Resource]:
    """The nodes with these ids, in id order."""
    return Resource.objects.filter(pk__in=list(ids)).order_by("pk")


def labs() -> QuerySet[Lab]:
    """All labs."""
    return Lab.objects.all()


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


def permissions_of(user: User, roles: Iterable[str] | None = None) -> frozenset[Permission]:
    """Return what the user may do anywhere; what they may do to a resource is `require`."""
    return account_selectors.permissions_of(user, roles)


def permissions_on_all(user: User, lab: Lab | None = None) -> frozenset[Permission]:
    """Return what the user may do to all of the lab: drivers belong to no part of it."""
    return account_selectors.permissions_on(user, root_of(lab or the_lab()).id)


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


def is_taken(lab: Lab, resource_id: UUID, key: str) -> bool:
    """Tell whether a resource of this id, or of this key in the lab, is there already."""
    return Resource.objects.filter(Q(pk=resource_id) | Q(lab=lab, key=key)).exists()
