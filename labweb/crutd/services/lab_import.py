"""Bring a whole lab file into the database, or nothing of it."""

from __future__ import annotations

import zoneinfo
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from django.db.transaction import atomic
from django.utils.text import slugify

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common.clock import now
from labweb.crutd.models import EventHead, LabBase, Transaction
from labweb.crutd.selectors.history_replay import pack
from labweb.crutd.selectors.lab_export import file_extra
from labweb.crutd.services.events import record
from labweb.crutd.services.ledger_posting import post
from labweb.domain.crutd import operations
from labweb.domain.crutd.ledger import Account
from labweb.domain.crutd.settlement import Change, Posting
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import LabFileError, StateError
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.resources.resource import Resource as ResourceData
from labweb.resources import selectors as resource_selectors
from labweb.resources import services as resource_services
from labweb.resources.selectors import Connection, Lab, Lot, Material, Resource

LONGEST_KEY = 50
"""Longest key of a lab, which stands in addresses of pages."""


@atomic
def import_lab(lab_file: LabFile, *, actor: User | None, source: dict[str, str]) -> Lab:
    """Write a lab that was read and checked as a whole.

    Raises:
        LabFileError: This machine knows no such time zone. Nothing was written.
        StateError: A lab of that name exists already. Nothing was written.

    Effect:
        Contents are received from outside: each amount leaves RECEIPT and enters its vessel.
    """
    check_time_zone(lab_file)
    if resource_selectors.labs().filter(pk=lab_file.id).exists():
        raise StateError(f"the lab {lab_file.name!r} exists already", code="lab.exists")
    lab = resource_services.create_lab(
        id=lab_file.id,
        key=_free_key(lab_file),
        name=lab_file.name,
        mode=lab_file.mode.value,
        time_zone=lab_file.time_zone,
        source=source,
        extra=file_extra(lab_file),
    )
    resource_services.create_nodes(lab, _nodes(lab_file))
    resource_services.create_links(
        list(_connections(lab, lab_file)),
        list(_materials(lab, lab_file)),
        list(_lots(lab, lab_file)),
    )
    _receive(lab, lab_file, actor)
    account_services.write_audit("lab.import", str(lab.id), actor=actor, detail=source)
    return lab


@dataclass(frozen=True, slots=True)
class Rows:
    """What a lab file becomes in the tables; not written yet."""

    resources: list[Resource]
    connections: list[Connection]
    materials: list[Material]
    lots: list[Lot]


def rows_of(lab: Lab, lab_file: LabFile) -> Rows:
    """Return the rows of a lab file, each after what it refers to."""
    return Rows(
        list(_resources(lab, lab_file)),
        list(_connections(lab, lab_file)),
        list(_materials(lab, lab_file)),
        list(_lots(lab, lab_file)),
    )


@cache
def _time_zones() -> frozenset[str]:
    """Return the zones that this machine knows; looked up in its files once."""
    return frozenset(zoneinfo.available_timezones())


def check_time_zone(lab_file: LabFile) -> None:
    """See to it that times can be shown in the lab's zone.

    Raises:
        LabFileError: This machine knows no such zone.
    """
    if lab_file.time_zone not in _time_zones():
        raise LabFileError(
            f"there is no time zone {lab_file.time_zone!r}; name one like Europe/Zurich or UTC",
            code="lab_file.time_zone",
            context={"field": "time_zone"},
        )


def _free_key(lab_file: LabFile) -> str:
    """Return the name as a key, or the id when the name gives none that is free."""
    key = slugify(lab_file.name)[:LONGEST_KEY].strip("-")
    is_taken = resource_selectors.labs().filter(key=key).exists()
    return lab_file.id.hex if not key or is_taken else key


def _resources(lab: Lab, lab_file: LabFile) -> Iterator[Resource]:
    for node, position in _nodes(lab_file):
        yield Resource(
            id=node.id,
            lab=lab,
            parent_id=node.parent_id,
            key=node.key,
            name=node.name,
            kind=node.kind,
            nature=node.nature.value,
            pose=None if node.pose is None else node.pose.to_json(),
            size_mm=None if node.size_mm is None else list(node.size_mm),
            config=dict(node.config),
            data=dict(node.data),
            extra=dict(node.extra),
            position=position,
        )


def _nodes(lab_file: LabFile) -> Iterator[tuple[ResourceData, int]]:
    places = {node.id: place for place, node in enumerate(lab_file.resources)}
    for node in _parents_first(lab_file):
        yield node, places[node.id]


def _parents_first(lab_file: LabFile) -> Iterator[ResourceData]:
    for root in lab_file.tree.children.get(None, ()):
        yield root
        yield from lab_file.tree.descendants(root.id)


def _connections(lab: Lab, lab_file: LabFile) -> Iterator[Connection]:
    for position, edge in enumerate(lab_file.connections):
        yield Connection(
            id=edge.id,
            lab=lab,
            key=edge.key,
            source_id=edge.source.resource_id,
            source_port=edge.source.port,
            target_id=edge.target.resource_id,
            target_port=edge.target.port,
            medium=edge.medium.value,
            is_two_way=edge.is_two_way,
            dead_volume_nl=edge.dead_volume_nl,
            extra=dict(edge.extra),
            position=position,
        )


def _materials(lab: Lab, lab_file: LabFile) -> Iterator[Material]:
    for position, material in enumerate(lab_file.materials):
        yield Material(
            id=material.id,
            lab=lab,
            key=material.key,
            name=material.name,
            inchikey=material.inchikey or "",
            density_mg_ul=material.density_mg_ul,
            concentration_mmol_l=material.concentration_mmol_l,
            ph=material.ph,
            hazards=list(material.hazards),
            groups=list(material.groups),
            incompatible_with=list(material.incompatible_with),
            position=position,
        )


def _lots(lab: Lab, lab_file: LabFile) -> Iterator[Lot]:
    for position, lot in enumerate(lab_file.lots):
        yield Lot(
            id=lot.id,
            lab=lab,
            key=lot.key,
            material_id=lot.material_id,
            supplier=lot.supplier or "",
            number=lot.number or "",
            expires_on=lot.expires_on,
            purity=lot.purity or "",
            phase=lot.phase.value,
            position=position,
        )


def _receive(lab: Lab, lab_file: LabFile, actor: User | None) -> None:
    root = lab_file.tree.children[None][0]
    operation = operations.Create(
        resource_id=root.id, parent_id=root.id, key=root.key, name=root.name, kind=root.kind
    )
    row = Transaction.objects.create(
        lab=lab,
        state=TransactionState.COMMITTED.value,
        name=operations.OperationName.CREATE.value,
        operation=operations.to_json(operation),
        actor=actor,
        proposed_at=now(),
        settled_at=now(),
        verification="assumed",
        message=f"imported {len(lab_file.resources)} resources",
    )
    postings = tuple(_postings(lab_file))
    post(row, postings, ())
    base = _keep_base(lab, lab_file)
    EventHead.objects.create(lab=lab)
    record(row, Change(state=TransactionState.COMMITTED, postings=postings), base=base.sha256)


def _keep_base(lab: Lab, lab_file: LabFile) -> LabBase:
    """Keep the lab as it was imported, for events to be replayed on."""
    document, sha256 = pack(lab_file)
    base: LabBase = LabBase.objects.create(lab=lab, document=document, sha256=sha256)
    return base


def _postings(lab_file: LabFile) -> Iterator[Posting]:
    for resource_id, amounts in lab_file.contents.items():
        for lot, amount_nl in amounts.items():
            yield Posting(lot, Account.RECEIPT.value, str(resource_id), amount_nl=amount_nl)
    for resource_id, amounts in lab_file.masses.items():
        for lot, amount_ug in amounts.items():
            yield Posting(lot, Account.RECEIPT.value, str(resource_id), amount_ug=amount_ug)
