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

import msgspec

from labweb.domain.crutd.ledger import Account, posted
from labweb.domain.crutd.ledger import Posting as Posting
from labweb.domain.crutd.lots_of_partial_transfer import drawn_parts, part_of
from labweb.domain.crutd.operation_checks import check as check
from labweb.domain.crutd.operations import (
    Correct,
    Create,
    Delete,
    Disconnect,
    Dispose,
    Operation,
    React,
    Read,
    Receive,
    Refit,
    Restore,
    TransferLiquid,
    TransferMass,
    TransferResource,
    Update,
    touched_ids,
)
from labweb.domain.crutd.reaction import react_postings
from labweb.domain.crutd.snapshot import ResourceState as ResourceState
from labweb.domain.crutd.snapshot import Snapshot as Snapshot
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import StateError
from labweb.domain.resources.contents_by_lot import (
    Contents,
    LotId,
    Phase,
    take,
    total_nl,
)


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

    moved_ug: int | None = None
    """The same for a transfer by mass."""

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

    poses: Mapping[UUID, Mapping[str, Any]] = field(default_factory=dict)
    """Poses that are known where things have come to; of all others they are unknown."""

    archived: frozenset[UUID] = frozenset()
    quarantined: frozenset[UUID] = frozenset()
    restored: frozenset[UUID] = frozenset()
    """Resources that come back out of the Archive."""

    created: tuple[Create, ...] = ()
    configs: Mapping[UUID, Mapping[str, Any]] = field(default_factory=dict)
    """New configuration by resource: parts of a device whose driver is another version."""

    released: frozenset[UUID] = frozenset()
    """Resources whose quarantine ends: the server adds those of a doubt that is over."""

    def to_json(self) -> dict[str, Any]:
        """Render as plain data; equal changes render equal."""
        poses = {str(k): dict(v) for k, v in sorted(self.poses.items())}
        configs = {str(k): dict(v) for k, v in sorted(self.configs.items())}
        return {
            "state": self.state.value,
            "postings": [posting.to_json() for posting in sorted(self.postings)],
            "data": {str(k): dict(v) for k, v in sorted(self.data.items())},
            "moves": {str(k): str(v) for k, v in sorted(self.moves.items())},
            "archived": sorted(str(i) for i in self.archived),
            "quarantined": sorted(str(i) for i in self.quarantined),
            "created": [str(c.resource_id) for c in self.created],
            "restored": sorted(str(i) for i in self.restored),
            "released": sorted(str(i) for i in self.released),
            **({"configs": configs} if configs else {}),
            **({"poses": poses} if poses else {}),
        }


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
    if isinstance(operation, React):
        return _settle_reacted(operation, snapshot, outcome)
    if isinstance(operation, TransferLiquid | TransferMass):
        return _settle_poured(operation, snapshot, outcome)
    if isinstance(operation, Dispose) and operation.amount_nl is not None:
        return _settle_drawn(operation, snapshot, outcome)
    if outcome.kind is OutcomeKind.PARTIAL:
        return Change(state=TransactionState.ROLLED_BACK)
    if isinstance(operation, Receive | Correct | Dispose):
        return _settle_booked(operation, snapshot)
    return _settle_placed(operation, outcome)


def given_up(operation: Operation) -> dict[UUID, dict[str, None]]:
    """Return what nobody knows any more of resources' `data`, once a person cannot tell either.

    Example:
        >>> heater = UUID(int=1)
        >>> given_up(Update(resource_id=heater, data={"temperature_setpoint_c": 60.0}))
        {UUID('00000000-0000-0000-0000-000000000001'): {'temperature_setpoint_c': None}}
    """
    if not isinstance(operation, Update):
        return {}
    return {operation.resource_id: dict.fromkeys(operation.data)}


def _settle_placed(
    operation: Create | Read | Update | TransferResource | Delete | Restore | Refit | Disconnect,
    outcome: Outcome,
) -> Change:
    committed = TransactionState.COMMITTED
    match operation:
        case Read() | Disconnect():
            return Change(state=committed)
        case Update():
            merged = {**operation.data, **outcome.data}
            return Change(state=committed, data={operation.resource_id: merged})
        case TransferResource():
            return Change(state=committed, moves={operation.resource_id: operation.to_id})
        case Restore():
            return _settle_restored(operation)
        case Delete():
            return Change(
                state=committed,
                moves={operation.resource_id: operation.archive_id},
                archived=frozenset({operation.resource_id}),
            )
        case Create():
            return Change(state=committed, created=(operation,))
        case Refit():
            return _settle_refit(operation)


def _settle_restored(operation: Restore) -> Change:
    """Put a thing back into service; with its pose, where it goes to where it stood."""
    if not isinstance(operation.to_id, UUID):
        raise StateError("nobody said where it goes", code="crutd.no_former_place")
    thing = operation.resource_id
    return Change(
        state=TransactionState.COMMITTED,
        moves={thing: operation.to_id},
        restored=frozenset({thing}),
        poses={} if operation.pose is None else {thing: operation.pose},
    )


def _settle_refit(operation: Refit) -> Change:
    """Write down which parts a device has from now on."""
    archive = operation.archive_id
    gone = {} if isinstance(archive, msgspec.UnsetType) else dict.fromkeys(operation.gone, archive)
    return Change(
        state=TransactionState.COMMITTED,
        created=operation.added,
        moves={**gone, **operation.back},
        archived=frozenset(operation.gone),
        restored=frozenset(operation.back),
        configs=operation.configs,
    )


def _settle_poured(
    operation: TransferLiquid | TransferMass, snapshot: Snapshot, outcome: Outcome
) -> Change:
    source, target = snapshot[operation.source_id], snapshot[operation.target_id]
    if isinstance(operation, TransferLiquid):
        asked, told, phase = operation.amount_nl, outcome.moved_nl, Phase.LIQUID
        there, inside, room = source.contents, target.contents, target.capacity_nl
    else:
        asked, told, phase = operation.amount_ug, outcome.moved_ug, operation.phase
        if told is None and outcome.kind is OutcomeKind.PARTIAL and outcome.moved_nl == 0:
            told = 0
        there, inside, room = source.masses, target.masses, target.capacity_ug
    if outcome.kind is OutcomeKind.PARTIAL and told is None:
        raise StateError("a partial transfer must say how much moved", code="crutd.no_amount")
    moved = asked if told is None else told
    if moved < 0:
        raise StateError(f"{phase.render(moved)} cannot have moved", code="crutd.not_positive")
    if moved == 0:
        return Change(state=TransactionState.ROLLED_BACK)
    is_liquid = isinstance(operation, TransferLiquid)
    parts = operation.parts_nl if isinstance(operation, TransferLiquid) else operation.parts_ug
    is_short = any(part > there.get(LotId(lot), 0) for lot, part in parts.items())
    is_known = is_liquid or source.knows_masses
    if is_known and (moved > total_nl(there) or is_short):
        held = phase.render(total_nl(there))
        raise StateError(
            f"{phase.render(moved)} moved out of {source.name}, which held {held}",
            code="crutd.contradiction",
        )
    if room is not None and moved > room - total_nl(inside):
        raise StateError(
            f"{phase.render(moved)} moved into {target.name}, which has room for "
            f"{phase.render(room - total_nl(inside))}",
            code="crutd.contradiction",
        )
    ends = (str(operation.source_id), str(operation.target_id))
    postings = _postings(drawn_parts(there, parts, moved), phase, ends)
    if isinstance(operation, TransferLiquid) and operation.carries_ug:
        postings += _postings(_carried(operation, source, target, moved), Phase.SOLID, ends)
    return Change(state=TransactionState.COMMITTED, postings=postings)


def _carried(
    operation: TransferLiquid, source: ResourceState, target: ResourceState, moved_nl: int
) -> Contents:
    shares = part_of(operation, moved_nl).carries_ug
    carried = {LotId(lot): ug for lot, ug in shares.items() if ug}
    if source.knows_masses and any(ug > source.masses.get(lot, 0) for lot, ug in carried.items()):
        text = f"more of a solid went along than {source.name} held"
        raise StateError(text, code="crutd.contradiction")
    room = target.capacity_ug
    if room is not None and total_nl(carried) > room - total_nl(target.masses):
        text = f"more of solids went along than {target.name} has room for"
        raise StateError(text, code="crutd.contradiction")
    return carried


def _settle_reacted(operation: React, snapshot: Snapshot, outcome: Outcome) -> Change:
    """Post a reaction that is known to have come to its end.

    How far one went that was broken off, no device can tell: its vessel is quarantined, and a
    person takes stock.
    """
    if outcome.kind is OutcomeKind.PARTIAL:
        quarantined = frozenset({operation.resource_id})
        return Change(state=TransactionState.QUARANTINED, quarantined=quarantined)
    state = snapshot[operation.resource_id]
    for share in operation.reactants:
        lot = LotId(str(share.lot_id))
        is_less = share.amount_ug > state.masses.get(lot, 0) and state.knows_masses
        if share.amount_nl > state.contents.get(lot, 0) or is_less:
            raise StateError(
                f"more of lot {lot} reacted than {state.name} held", code="crutd.contradiction"
            )
    return Change(state=TransactionState.COMMITTED, postings=react_postings(operation))


def _postings(parts: Contents, phase: Phase, ends: tuple[str, str]) -> tuple[Posting, ...]:
    debit, credit = ends
    return tuple(
        posted(lot, phase, debit=debit, credit=credit, amount=part) for lot, part in parts.items()
    )


def _settle_booked(operation: Receive | Correct | Dispose, snapshot: Snapshot) -> Change:
    """Post what enters or leaves the lab by hand, in the unit of each lot."""
    committed = TransactionState.COMMITTED
    match operation:
        case Receive():
            lot = LotId(str(operation.lot_id))
            postings = [
                posted(
                    lot,
                    operation.phase,
                    debit=Account.RECEIPT.value,
                    credit=str(portion.resource_id),
                    amount=portion.amount_nl or portion.amount_ug,
                )
                for portion in operation.portions
            ]
            return Change(state=committed, postings=tuple(postings))
        case Correct():
            state = snapshot[operation.resource_id]
            differences = (
                *_differences(operation, state.contents, operation.measured_nl, Phase.LIQUID),
                *_differences(operation, state.masses, operation.measured_ug, Phase.SOLID),
            )
            return Change(
                state=committed,
                postings=differences,
                released=frozenset({operation.resource_id}),
            )
        case Dispose():
            state = snapshot[operation.resource_id]
            is_all = operation.amount_nl is None and operation.amount_ug is None
            liquid = total_nl(state.contents) if is_all else operation.amount_nl or 0
            solid = total_nl(state.masses) if is_all else operation.amount_ug or 0
            ends = (str(operation.resource_id), Account.WASTE.value)
            gone = _postings(take(state.contents, liquid), Phase.LIQUID, ends)
            gone += _postings(take(state.masses, solid), Phase.SOLID, ends)
            return Change(state=committed, postings=gone)


def _settle_drawn(operation: Dispose, snapshot: Snapshot, outcome: Outcome) -> Change:
    """Post what was drawn out of a vessel for good: what the device tells, else what was asked."""
    told_nl = outcome.moved_nl
    if told_nl is None:
        told_nl = 0 if outcome.kind is OutcomeKind.PARTIAL else operation.amount_nl or 0
    source = snapshot[operation.resource_id]
    if not 0 <= told_nl <= total_nl(source.contents):
        raise StateError(
            f"{told_nl} nL were drawn out of {source.name}, which held "
            f"{total_nl(source.contents)} nL",
            code="crutd.contradiction",
        )
    solid_ug = operation.amount_ug if outcome.kind is OutcomeKind.DONE else None
    if told_nl == 0 and not solid_ug:
        return Change(state=TransactionState.ROLLED_BACK)
    drawn = msgspec.structs.replace(operation, amount_nl=told_nl, amount_ug=solid_ug)
    return _settle_booked(drawn, snapshot)


def _differences(
    operation: Correct, recorded: Contents, measured: Mapping[str, int], phase: Phase
) -> tuple[Posting, ...]:
    """Return what has to leave a vessel, or enter it, until it holds what was measured."""
    vessel, account = str(operation.resource_id), operation.account.value
    postings = []
    for lot in sorted({*recorded, *map(LotId, measured)}):
        change = measured.get(lot, 0) - recorded.get(lot, 0)
        debit, credit = (account, vessel) if change > 0 else (vessel, account)
        if change:
            postings.append(posted(lot, phase, debit=debit, credit=credit, amount=abs(change)))
    return tuple(postings)
