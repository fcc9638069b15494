"""The lab from its events: what was imported, and every settled transaction on top of it.

A pure fold. It reads what events say and nothing else, so that what the rows say can be
compared with it, and so that it can stop at any event.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.crutd import operations
from labweb.domain.crutd.ledger import Amount, Posting, book, posting_from, vessels_of
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import Finding, ReconcileError
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.ports_and_connections import Connection
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.resources.resource_kinds import KINDS


@dataclass(frozen=True, slots=True, kw_only=True)
class Happening:
    """One event, as the chain keeps it."""

    seq: int
    transaction_id: str
    body: Mapping[str, Any]


@dataclass(slots=True, kw_only=True)
class ReplayNode:
    """One resource as the events left it."""

    id: UUID
    key: str
    name: str
    kind: str
    nature: str
    parent_id: UUID | None
    position: int = 0
    config: Mapping[str, Any] = field(default_factory=dict)
    data: Mapping[str, Any] = field(default_factory=dict)
    pose: Mapping[str, Any] | None = None
    rev: int = 1
    quarantined_by: str | None = None
    is_archived: bool = False


@dataclass(slots=True)
class Replay:
    """The tree, the ledger and the transactions at one moment."""

    nodes: dict[UUID, ReplayNode] = field(default_factory=dict)
    balances: dict[tuple[str, LotId], Amount] = field(default_factory=dict)
    states: dict[str, str] = field(default_factory=dict)
    """State of each transaction that an event tells of."""

    links: dict[UUID, Mapping[str, Any]] = field(default_factory=dict)
    """Connections, those of the import among them."""

    def contents(self, vessel: UUID) -> dict[LotId, Amount]:
        """Return what a vessel holds, by lot."""
        account = str(vessel)
        return {lot: amount for (name, lot), amount in self.balances.items() if name == account}


@dataclass(frozen=True, slots=True, kw_only=True)
class Dated:
    """An event with its moment, and what it is about."""

    event: Happening
    at: datetime
    subjects: frozenset[UUID]


def as_of(events: Iterable[Dated], at: datetime, seq: int | None = None) -> Iterator[Happening]:
    """Yield what had happened by a moment, whenever it was heard of, in the order of the chain.

    What counts on something that had not happened yet is left out with it, whatever its time
    says: a cause is never missing.

    Args:
        events: In the order of the chain.
        at: The moment, its end included.
        seq: Of the events at the very moment, the last one that counts; None: all of them.
    """
    to_come: set[UUID | str] = set()
    for one in events:
        about: set[UUID | str] = {*one.subjects, one.event.transaction_id}
        is_later = one.at > at or (one.at == at and seq is not None and one.event.seq > seq)
        if is_later or not to_come.isdisjoint(about):
            to_come |= about
        else:
            yield one.event


def begin(lab: LabFile) -> Replay:
    """Return the lab as it was imported, before its first event: the tree, and no matter."""
    replay = Replay()
    for position, resource in enumerate(lab.resources):
        replay.nodes[resource.id] = ReplayNode(
            id=resource.id,
            key=resource.key,
            name=resource.name,
            kind=resource.kind,
            nature=resource.nature.value,
            parent_id=resource.parent_id,
            position=position,
            config=resource.config,
            data=resource.data,
            pose=None if resource.pose is None else resource.pose.to_json(),
        )
    replay.links = {one.id: link(one) for one in lab.connections}
    return replay


def link(connection: Connection) -> Mapping[str, Any]:
    """Return a connection as events tell of one."""
    return {
        "id": str(connection.id),
        "key": connection.key,
        "source_id": str(connection.source.resource_id),
        "source_port": connection.source.port,
        "target_id": str(connection.target.resource_id),
        "target_port": connection.target.port,
        "medium": connection.medium.value,
    }


def fold(replay: Replay, events: Iterable[Happening]) -> Replay:
    """Apply events in their order, in place, and return the same replay.

    Raises:
        ReconcileError: An event cannot be read, or tells of a resource that is not there.
    """
    for event in events:
        try:
            _apply(replay, event)
        except (KeyError, TypeError, ValueError, AttributeError, msgspec.ValidationError) as error:
            raise ReconcileError(
                f"event {event.seq} cannot be replayed: {error}",
                code="rebuild.unreadable",
                context={"seq": event.seq},
            ) from error
    return replay


def _apply(replay: Replay, event: Happening) -> None:
    change = event.body["change"]
    replay.states[event.transaction_id] = TransactionState(change["state"]).value
    _create(replay, event)
    postings = [posting_from(plain) for plain in change["postings"]]
    book(replay.balances, postings)
    for node, fields in _each(replay, change["data"]):
        node.data = {**node.data, **fields}
    for node, config in _each(replay, change.get("configs", {})):
        node.config = config
    for node, parent_id in _each(replay, change["moves"]):
        node.parent_id, node.pose = UUID(parent_id), None
    for node, pose in _each(replay, change.get("poses", {})):
        node.pose = pose
    for node in _listed(replay, change["archived"]):
        node.is_archived = True
    for node in _listed(replay, change.get("restored", ())):
        node.is_archived = False
    for node in _listed(replay, change.get("released", ())):
        node.quarantined_by = None
    for node in _listed(replay, change["quarantined"]):
        node.quarantined_by = event.transaction_id
    _count(replay, event.body, postings)


def _each(replay: Replay, changed: Mapping[str, Any]) -> Iterator[tuple[ReplayNode, Any]]:
    return ((replay.nodes[UUID(key)], value) for key, value in changed.items())


def _listed(replay: Replay, ids: Iterable[str]) -> Iterator[ReplayNode]:
    return (replay.nodes[UUID(key)] for key in ids)


def _create(replay: Replay, event: Happening) -> None:
    created = set(event.body["change"]["created"])
    if event.body["operation"].get("op") == "refit":
        _refit(replay, event.body, created)
        return
    if event.body["operation"].get("op") == "disconnect":
        _disconnect(replay, event.body)
    if not created:
        return
    operation = operations.from_json(event.body["operation"])
    if not isinstance(operation, operations.Create) or created != {str(operation.resource_id)}:
        raise ValueError("it creates what its operation does not name")
    replay.nodes[operation.resource_id] = _made(operation)
    for part in event.body.get("parts", ()):
        replay.nodes[UUID(part["id"])] = _part(part)
    for link in event.body.get("links", ()):
        replay.links[UUID(link["id"])] = link


def _refit(replay: Replay, body: Mapping[str, Any], created: set[str]) -> None:
    """Add the parts that a device got with another version of its driver, and part the tubes."""
    operation = operations.from_json(body["operation"])
    if TransactionState(body["change"]["state"]) is not TransactionState.COMMITTED:
        return
    if not isinstance(operation, operations.Refit) or created != {
        str(one.resource_id) for one in operation.added
    }:
        raise ValueError("it creates what its operation does not name")
    replay.nodes |= {one.resource_id: _made(one) for one in operation.added}
    for link_id in operation.parted:
        replay.links.pop(link_id, None)
    for joint in operation.joined:
        replay.links[joint.id] = msgspec.to_builtins(joint)


def _disconnect(replay: Replay, body: Mapping[str, Any]) -> None:
    """Take a connection off."""
    if TransactionState(body["change"]["state"]) is TransactionState.COMMITTED:
        del replay.links[UUID(body["operation"]["connection_id"])]


def _made(create: operations.Create) -> ReplayNode:
    return ReplayNode(
        id=create.resource_id,
        key=create.key,
        name=create.name,
        kind=create.kind,
        nature=KINDS[create.kind].nature.value,
        parent_id=create.parent_id,
        config=create.config,
    )


def _part(part: Mapping[str, Any]) -> ReplayNode:
    """Read what was created along with a piece of labware or a device: a well, a valve."""
    return ReplayNode(
        id=UUID(part["id"]),
        key=part["key"],
        name=part["name"],
        kind=part["kind"],
        nature=KINDS[part["kind"]].nature.value,
        parent_id=UUID(part["parent_id"]),
        position=part["position"],
        config=part["config"],
        pose=part["pose"],
    )


def _count(replay: Replay, body: Mapping[str, Any], postings: Iterable[Posting]) -> None:
    """Raise the counters: to what the edge reported, or else by one."""
    if body.get("revs"):
        for key, rev in body["revs"].items():
            if UUID(key) in replay.nodes:
                replay.nodes[UUID(key)].rev = rev
        return
    change = body["change"]
    if "base" in body:
        return
    names = ("data", "moves", "archived", "restored", "released", "configs")
    listed = {UUID(key) for name in names for key in change.get(name, ())}
    for node in vessels_of(postings) | listed:
        replay.nodes[node].rev += 1


def differences(told: Replay, kept: Replay) -> list[Finding]:
    """List every way in which the rows (`kept`) are not what the events tell (`told`)."""
    return [
        *_tree_differences(told.nodes, kept.nodes),
        *_ledger_differences(told.balances, kept.balances),
        *_state_differences(told.states, kept.states),
        *_link_differences(told.links, kept.links),
    ]


def _tree_differences(
    told: Mapping[UUID, ReplayNode], kept: Mapping[UUID, ReplayNode]
) -> Iterator[Finding]:
    for key in sorted(told.keys() | kept.keys()):
        one, other = told.get(key), kept.get(key)
        if one is None or other is None:
            missing = "no event tells of it" if one is None else "it has no row"
            yield Finding("rebuild.tree", f"resource {key}: {missing}", str(key))
            continue
        for name in ReplayNode.__slots__:
            events, rows = getattr(one, name), getattr(other, name)
            if events != rows:
                text = f"{one.name}: {name} is {rows!r}, the events tell {events!r}"
                yield Finding("rebuild.tree", text, str(key), {"field": name})


def _ledger_differences(
    told: Mapping[tuple[str, LotId], Amount], kept: Mapping[tuple[str, LotId], Amount]
) -> Iterator[Finding]:
    for key in sorted(told.keys() | kept.keys()):
        one, other = told.get(key, Amount()), kept.get(key, Amount())
        if one != other:
            account, lot = key
            text = (
                f"{account}, lot {lot}: the rows say {other.nl} nL and {other.ug} µg, "
                f"the events tell {one.nl} nL and {one.ug} µg"
            )
            yield Finding("rebuild.ledger", text, account, {"lot": lot})


def _link_differences(
    told: Mapping[UUID, Mapping[str, Any]], kept: Mapping[UUID, Mapping[str, Any]]
) -> Iterator[Finding]:
    for key in sorted(told.keys() | kept.keys()):
        one, other = told.get(key), kept.get(key)
        if one != other:
            text = f"connection {key} is {other or 'not there'}, the events tell {one or 'of none'}"
            yield Finding("rebuild.graph", text, str(key))


_LIVE = frozenset(state.value for state in TransactionState) - {"committed", "rolled_back"}


def _state_differences(told: Mapping[str, str], kept: Mapping[str, str]) -> Iterator[Finding]:
    """Compare final states and doubts; what is still under way has no event yet."""
    for key in sorted(told.keys() | kept.keys()):
        one, other = told.get(key), kept.get(key)
        if one == other or (one is None and other in _LIVE - {"quarantined"}):
            continue
        text = f"transaction {key} is {other or 'not there'}, the events tell {one or 'nothing'}"
        yield Finding("rebuild.state", text, key)
