"""The lab from its events: whole, or up to a moment, and beside what the rows say."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from uuid import UUID

import msgspec
from django.db.models import Max, Sum

from labweb.common.clock import now
from labweb.crutd.models import Entry, Event, Holding, LabBase, Transaction
from labweb.crutd.selectors.event_chain import events_in_order
from labweb.domain.crutd import operations
from labweb.domain.crutd.event_replay import (
    Dated,
    Happening,
    Replay,
    ReplayNode,
    as_of,
    begin,
    differences,
    fold,
    link,
)
from labweb.domain.crutd.ledger import Account, Amount
from labweb.domain.errors import DefinitionError, Finding, ReconcileError
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.resources.resource_tree import in_tree_order
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab, Resource


def pack(lab_file: LabFile) -> tuple[bytes, str]:
    """Return a lab file compressed, to be kept, and the digest that its event carries."""
    document = msgspec.json.encode(lab_file)
    return zlib.compress(document, level=1), hashlib.sha256(document).hexdigest()


def base_document(lab: Lab) -> tuple[bytes, str]:
    """Return the lab file of the import, as it was kept, and the digest kept beside it.

    Raises:
        ReconcileError: Nothing was kept of the import, or it cannot be unpacked.
    """
    base = LabBase.objects.filter(lab=lab).first()
    if base is None:
        raise ReconcileError(
            f"{lab.name} was imported before imports were kept: it cannot be replayed",
            code="rebuild.no_base",
        )
    try:
        return zlib.decompress(base.document), base.sha256
    except zlib.error as error:
        raise _unreadable(lab, error) from error


def base_of(lab: Lab) -> LabFile:
    """Return the lab as it was imported.

    Raises:
        ReconcileError: Nothing was kept of the import, or it is not what was kept.
    """
    try:
        return msgspec.json.decode(base_document(lab)[0], type=LabFile)
    except msgspec.MsgspecError as error:
        raise _unreadable(lab, error) from error


def _unreadable(lab: Lab, error: Exception) -> ReconcileError:
    return ReconcileError(f"the import of {lab.name} cannot be read: {error}", code="rebuild.base")


def begun_at(lab: Lab) -> datetime:
    """Return when a lab was made here: nothing of it happened before."""
    found = Event.objects.filter(lab=lab).order_by("seq").values_list("at", flat=True).first()
    return now() if found is None else found


def _happening(event: Event) -> Happening:
    return Happening(seq=event.seq, transaction_id=str(event.transaction_id), body=event.body)


def _dated(lab: Lab, last: int) -> Iterator[Dated]:
    for event in events_in_order(lab, up_to=last):
        try:
            subjects = operations.subjects_of(operations.from_json(event.body["operation"]))
        except (KeyError, TypeError, ValueError, msgspec.ValidationError) as error:
            raise ReconcileError(
                f"event {event.seq} cannot be replayed: {error}", code="rebuild.unreadable"
            ) from error
        about = frozenset(resource_id for resource_id, _ in subjects)
        yield Dated(event=_happening(event), at=event.at, subjects=about)


def replayed(lab: Lab, *, up_to: int | None = None) -> Replay:
    """Return the lab as its events tell it, to the last one or to the one with this number.

    Raises:
        ReconcileError: The import or an event cannot be read.
    """
    return fold(begin(base_of(lab)), map(_happening, events_in_order(lab, up_to=up_to)))


def replayed_to(lab: Lab, at: datetime, seq: int | None = None) -> Replay | None:
    """Return the lab by what had happened up to a moment; None: it was imported later.

    What happened by then counts though the server heard of it later.

    Args:
        lab: Which.
        at: The moment, its end included.
        seq: Of the events at that very moment, the last that counts; None: all.

    Raises:
        ReconcileError: The import or an event cannot be read.
    """
    rows = Event.objects.filter(lab=lab, at__lte=at)
    last = rows.aggregate(last=Max("seq"))["last"]
    if last is None:
        return None
    return fold(begin(base_of(lab)), as_of(_dated(lab, last), at, seq))


def kept(lab: Lab) -> Replay:
    """Return the lab as its rows say, in the same shape."""
    nodes = {row.id: _node(row) for row in resource_selectors.resources_of(lab)}
    held = Holding.objects.filter(resource__lab=lab)
    balances = {
        (str(vessel), LotId(str(lot))): Amount(nl, ug)
        for vessel, lot, nl, ug in held.values_list("resource", "lot", "amount_nl", "amount_ug")
        if nl or ug
    }
    for side, sign in (("debit", -1), ("credit", 1)):
        posted = Entry.objects.filter(transaction__lab=lab, state=Entry.State.POSTED)
        nominal = posted.filter(**{f"{side}__in": [account.value for account in Account]})
        sums = nominal.values(side, "lot").annotate(nl=Sum("amount_nl"), ug=Sum("amount_ug"))
        for row in sums:
            key = (row[side], LotId(str(row["lot"])))
            amount = balances.get(key, Amount()) + Amount(sign * row["nl"], sign * row["ug"])
            balances[key] = amount
    states = Transaction.objects.filter(lab=lab).values_list("id", "state")
    rows = resource_selectors.connections_of(lab)
    links = {one.id: link(one) for one in resource_selectors.to_graph(rows).connections}
    return Replay(nodes, balances, {str(key): state for key, state in states}, links)


def _node(row: Resource) -> ReplayNode:
    return ReplayNode(
        id=row.id,
        key=row.key,
        name=row.name,
        kind=row.kind,
        nature=row.nature,
        parent_id=row.parent_id,
        position=row.position,
        config=row.config,
        data=row.data,
        pose=row.pose,
        rev=row.rev,
        quarantined_by=None if row.quarantined_by is None else str(row.quarantined_by),
        is_archived=row.is_archived,
    )


def rebuild_differences(lab: Lab) -> list[Finding]:
    """List every way in which the rows of a lab are not what its events tell.

    Raises:
        ReconcileError: The import or an event cannot be read.
    """
    return differences(replayed(lab), kept(lab))


@dataclass(frozen=True, slots=True)
class Past:
    """A lab at one moment, as rows that are in no table, and what its vessels held."""

    rows: list[Resource]
    contents: dict[UUID, dict[LotId, Amount]]
    depths: dict[UUID, int]


def as_it_was(lab: Lab, at: datetime, *, now: datetime) -> Past:
    """Return the tree and the contents of a lab as the events up to a moment tell them.

    Raises:
        DefinitionError: The moment is still to come, or before the lab was imported.
        ReconcileError: The import or an event cannot be read.
    """
    if at > now:
        raise DefinitionError("that time is still to come", code="time.future")
    replay = replayed_to(lab, at)
    if replay is None:
        raise DefinitionError(
            f"{lab.name} was not there at that time: it was imported later",
            code="time.before_lab",
        )
    contents: dict[UUID, dict[LotId, Amount]] = {}
    for (account, lot), amount in replay.balances.items():
        if account not in Account.__members__:
            contents.setdefault(UUID(account), {})[lot] = amount
    by_place = sorted(replay.nodes.values(), key=lambda node: (node.position, node.key))
    ordered = in_tree_order(by_place, lambda node: (node.id, node.parent_id))
    depths = {node.id: _depth(node, replay.nodes) for node in ordered}
    return Past([_row(node, lab) for node in ordered], contents, depths)


def _depth(node: ReplayNode, nodes: dict[UUID, ReplayNode]) -> int:
    depth = 0
    while node.parent_id is not None:
        node, depth = nodes[node.parent_id], depth + 1
    return depth


def _row(node: ReplayNode, lab: Lab) -> Resource:
    return Resource(
        id=node.id,
        lab=lab,
        parent_id=node.parent_id,
        key=node.key,
        name=node.name,
        kind=node.kind,
        nature=node.nature,
        position=node.position,
        config=node.config,
        data=node.data,
        pose=node.pose,
        rev=node.rev,
        quarantined_by=None if node.quarantined_by is None else UUID(node.quarantined_by),
        is_archived=node.is_archived,
    )
