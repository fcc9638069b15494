"""Decide what an operation may do, and what it did.

The edge settles with these functions when the device has reported; the server runs them
again on the event and compares. Both see the same frozen snapshot shape.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any
from uuid import UUID

from labweb.domain.crutd.ledger import Posting as Posting
from labweb.domain.crutd.lifecycle import TransactionState
from labweb.domain.crutd.operations import (
    Create,
    Delete,
    Operation,
    Read,
    TransferLiquid,
    TransferResource,
    Update,
    touched_ids,
)
from labweb.domain.errors import Finding, StateError
from labweb.domain.resources.contents import Contents, take, total_nl
from labweb.domain.resources.kinds import KINDS
from labweb.domain.units import render_volume


@dataclass(frozen=True, slots=True, kw_only=True)
class ResourceState:
    """What a decision needs to know of one resource."""

    id: UUID
    name: str
    kind: str
    parent_id: UUID | None = None
    contents: Contents = field(default_factory=dict)
    capacity_nl: int | None = None
    """None: nobody stated it, so nothing may be poured in."""

    dead_volume_nl: int = 0
    data: Mapping[str, Any] = field(default_factory=dict)
    quarantined_by: str | None = None
    """Transaction whose outcome nobody knows."""

    is_archived: bool = False
    has_children: bool = False
    ancestor_ids: tuple[UUID, ...] = ()


Snapshot = Mapping[UUID, ResourceState]


class OutcomeKind(StrEnum):
    """What the device's report amounts to."""

    DONE = "done"
    """It did what was asked."""

    PARTIAL = "partial"
    """It did a known part; `moved_nl` says which. Zero is none."""

    UNKNOWN = "unknown"
    """Nobody knows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What is known after acting."""

    kind: OutcomeKind
    moved_nl: int | None = None
    """For a liquid transfer: what moved. None with DONE means what was asked."""

    data: Mapping[str, Any] = field(default_factory=dict)
    """Statuses the device reported, for an Update."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """What is to be written; applied in one atomic block."""

    state: TransactionState
    postings: tuple[Posting, ...] = ()
    data: Mapping[UUID, Mapping[str, Any]] = field(default_factory=dict)
    """New `data` fields by resource."""

    moves: Mapping[UUID, UUID] = field(default_factory=dict)
    """New parent by resource."""

    archived: frozenset[UUID] = frozenset()
    quarantined: frozenset[UUID] = frozenset()
    created: tuple[Create, ...] = ()
    released: frozenset[UUID] = frozenset()
    """Resources whose quarantine ends; the server fills this in when it settles."""

    def to_json(self) -> dict[str, Any]:
        """Render as plain data; equal changes render equal."""
        return {
            "state": self.state.value,
            "postings": [posting.to_json() for posting in sorted(self.postings)],
            "data": {str(k): dict(v) for k, v in sorted(self.data.items())},
            "moves": {str(k): str(v) for k, v in sorted(self.moves.items())},
            "archived": sorted(str(i) for i in self.archived),
            "quarantined": sorted(str(i) for i in self.quarantined),
            "created": [str(c.resource_id) for c in self.created],
            "released": sorted(str(i) for i in self.released),
        }


def check(operation: Operation, snapshot: Snapshot) -> list[Finding]:
    """List every precondition the operation breaks; an empty list means go."""
    if isinstance(operation, Read):
        return []
    missing = [i for i in touched_ids(operation) if i not in snapshot]
    if missing:
        return [Finding("crutd.not_found", f"no resource {i}", str(i)) for i in missing]
    findings = _check_usable(operation, snapshot)
    match operation:
        case TransferLiquid():
            findings += _check_liquid(operation, snapshot)
        case TransferResource():
            findings += _check_carry(operation, snapshot)
        case Delete():
            findings += _check_delete(operation, snapshot)
        case Create():
            findings += _check_create(operation, snapshot)
        case Update():
            pass
    return findings


def _check_usable(operation: Operation, snapshot: Snapshot) -> list[Finding]:
    findings = []
    for resource_id in touched_ids(operation):
        state = snapshot[resource_id]
        if state.quarantined_by is not None:
            findings.append(
                Finding(
                    "crutd.quarantined",
                    f"{state.name} is quarantined: a person has to say what happened first",
                    str(resource_id),
                    {"transaction_id": state.quarantined_by},
                )
            )
        if state.is_archived:
            findings.append(
                Finding("crutd.archived", f"{state.name} is in the Archive", str(resource_id))
            )
    return findings


def _check_liquid(operation: TransferLiquid, snapshot: Snapshot) -> list[Finding]:
    source, target = snapshot[operation.source_id], snapshot[operation.target_id]
    if operation.source_id == operation.target_id:
        return [Finding("crutd.same_vessel", "source and target are the same vessel", source.name)]
    findings = []
    if operation.amount_nl <= 0:
        findings.append(
            Finding("crutd.not_positive", f"{operation.amount_nl} nL is no amount", source.name)
        )
    usable = total_nl(source.contents) - source.dead_volume_nl
    if operation.amount_nl > usable:
        findings.append(
            Finding(
                "crutd.insufficient_volume",
                f"{source.name} can give {render_volume(max(usable, 0))}, "
                f"asked for {render_volume(operation.amount_nl)}",
                source.name,
                {"resource_id": str(source.id), "usable_nl": usable},
            )
        )
    if target.capacity_nl is None:
        findings.append(
            Finding(
                "crutd.unknown_capacity",
                f"nobody stated how much {target.name} holds: set capacity_ul in its config",
                target.name,
                {"resource_id": str(target.id)},
            )
        )
    elif operation.amount_nl > target.capacity_nl - total_nl(target.contents):
        free = target.capacity_nl - total_nl(target.contents)
        findings.append(
            Finding(
                "crutd.capacity_exceeded",
                f"{target.name} has room for {render_volume(free)}, "
                f"asked for {render_volume(operation.amount_nl)}",
                target.name,
                {"resource_id": str(target.id), "free_nl": free},
            )
        )
    return findings


def _check_carry(operation: TransferResource, snapshot: Snapshot) -> list[Finding]:
    moved, to = snapshot[operation.resource_id], snapshot[operation.to_id]
    findings = []
    if moved.parent_id != operation.from_id:
        findings.append(
            Finding("crutd.not_there", f"{moved.name} does not stand there", moved.name)
        )
    kind = KINDS.get(to.kind)
    if kind is None or not kind.is_place:
        findings.append(Finding("crutd.no_place", f"{to.name} carries nothing", to.name))
    if operation.resource_id == operation.to_id or operation.resource_id in to.ancestor_ids:
        findings.append(
            Finding("crutd.into_itself", f"{moved.name} cannot stand in itself", moved.name)
        )
    return findings


def _check_delete(operation: Delete, snapshot: Snapshot) -> list[Finding]:
    state = snapshot[operation.resource_id]
    if state.parent_id is None:
        return [Finding("crutd.root", f"{state.name} is the root of the lab", state.name)]
    if snapshot[operation.archive_id].kind != "archive":
        return [Finding("crutd.no_archive", "the target is no Archive", state.name)]
    return []


def _check_create(operation: Create, snapshot: Snapshot) -> list[Finding]:
    findings = []
    if operation.kind not in KINDS:
        findings.append(Finding("crutd.unknown_kind", f"no kind {operation.kind!r}", operation.key))
    parent = snapshot[operation.parent_id]
    kind = KINDS.get(parent.kind)
    if kind is None or not kind.is_place:
        findings.append(Finding("crutd.no_place", f"{parent.name} carries nothing", parent.name))
    return findings


def confirmed_nl(asked_nl: int, moved_nl: int, resolution_nl: int) -> int:
    """Return the amount to post for a transfer that the device says it finished.

    A plunger moves in whole steps, the nearest to what was asked. Where what it reports is
    the asked amount to within half a step, the asked amount is confirmed; a larger
    difference is posted as it was measured. The planner refuses amounts for which half a
    step is more than a hundredth.

    Example:
        >>> confirmed_nl(3_333_000, 3_333_333, 1667)
        3333000
    """
    half_a_step_nl = (resolution_nl + 2) // 2 if resolution_nl else 0
    return asked_nl if abs(moved_nl - asked_nl) <= half_a_step_nl else moved_nl


def settle(operation: Operation, snapshot: Snapshot, outcome: Outcome) -> Change:
    """Decide what is written, once it is known (or known to be unknown) what happened.

    UNKNOWN quarantines every resource the operation touches and posts nothing.

    Raises:
        StateError: The report contradicts the record, such as more moved than was there.
            The caller quarantines.
    """
    touched = frozenset(touched_ids(operation))
    if outcome.kind is OutcomeKind.UNKNOWN:
        if isinstance(operation, Read):
            return Change(state=TransactionState.ROLLED_BACK)
        return Change(state=TransactionState.QUARANTINED, quarantined=touched)
    if isinstance(operation, TransferLiquid):
        return _settle_liquid(operation, snapshot, outcome)
    if outcome.kind is OutcomeKind.PARTIAL:
        return Change(state=TransactionState.ROLLED_BACK)
    match operation:
        case Read():
            return Change(state=TransactionState.COMMITTED)
        case Update():
            merged = {**operation.data, **outcome.data}
            return Change(state=TransactionState.COMMITTED, data={operation.resource_id: merged})
        case TransferResource():
            return Change(
                state=TransactionState.COMMITTED, moves={operation.resource_id: operation.to_id}
            )
        case Delete():
            return Change(
                state=TransactionState.COMMITTED,
                moves={operation.resource_id: operation.archive_id},
                archived=frozenset({operation.resource_id}),
            )
        case Create():
            return Change(state=TransactionState.COMMITTED, created=(operation,))


def _settle_liquid(operation: TransferLiquid, snapshot: Snapshot, outcome: Outcome) -> Change:
    moved = operation.amount_nl if outcome.moved_nl is None else outcome.moved_nl
    if outcome.kind is OutcomeKind.PARTIAL and outcome.moved_nl is None:
        raise StateError("a partial transfer must say how much moved", code="crutd.no_amount")
    if moved < 0:
        raise StateError(f"{moved} nL cannot have moved", code="crutd.not_positive")
    if moved == 0:
        return Change(state=TransactionState.ROLLED_BACK)
    source = snapshot[operation.source_id]
    if moved > total_nl(source.contents):
        raise StateError(
            f"{moved} nL moved out of {source.name}, which held {total_nl(source.contents)} nL",
            code="crutd.contradiction",
        )
    target = snapshot[operation.target_id]
    if target.capacity_nl is not None and moved > target.capacity_nl - total_nl(target.contents):
        raise StateError(
            f"{moved} nL moved into {target.name}, which has no room for it",
            code="crutd.contradiction",
        )
    debit, credit = str(operation.source_id), str(operation.target_id)
    return Change(
        state=TransactionState.COMMITTED,
        postings=tuple(
            Posting(lot, debit, credit, part) for lot, part in take(source.contents, moved).items()
        ),
    )
