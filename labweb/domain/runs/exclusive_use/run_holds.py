"""Holds: what a run keeps for itself between its actions, and when it may have more.

A lock is for one action. A hold is for a run: it lasts from the first use to the last, so that
nobody changes what the run counts on between two of its steps. Holds are granted one after the
other, and only while every run that has begun can still get all that it may need and end.

Source:
    E. W. Dijkstra, EWD 108 (1965) and EWD 623 (1977): the banker's algorithm, with resources of
    one instance each and with modes that may be shared.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from uuid import UUID

import msgspec

from labweb.domain.crutd import operations as ops
from labweb.domain.resources.resource_kinds import is_vessel


class UseMode(StrEnum):
    """How something is used, as far as others have to know."""

    ALONE = "X"
    """It is changed, or has to stay as it is, with all that stands in it."""

    DRAW = "S"
    """Liquid is only drawn from it: others may draw from it, too."""

    POUR = "P"
    """It is a waste, and only poured into: others may pour into it, too."""

    USE = "U"
    """A device acts. What others keep inside it stays as it is."""

    WITHIN = "I"
    """Something below it is used. Never held by itself."""


Modes = Mapping[UUID, UseMode]
Above = Mapping[UUID, Sequence[UUID]]

_SHARED = frozenset(
    {
        (UseMode.DRAW, UseMode.DRAW),
        (UseMode.POUR, UseMode.POUR),
        (UseMode.WITHIN, UseMode.WITHIN),
        (UseMode.WITHIN, UseMode.USE),
        (UseMode.USE, UseMode.WITHIN),
    }
)

ROOMY = frozenset({"archive", "bench", "deck", "foreign", "lab", "room", "site", "storage"})
"""Places where many things stand side by side: one more disturbs none of them."""

CARRIERS = frozenset({"pipette_channel", "sample_loop", "syringe_pump", "tip"})
"""What liquid only passes through: others may use it as soon as it is empty again."""


def keeps_matter(kind: str) -> bool:
    """Say whether what is in it belongs to the run that uses it: a vessel that is no waste."""
    return is_vessel(kind) and kind not in CARRIERS and kind != "waste"


def place_mode(kind: str) -> UseMode:
    """Return how a place is used that something is put into or taken from."""
    return UseMode.WITHIN if kind in ROOMY else UseMode.ALONE


def places_of(operation: ops.Operation) -> tuple[UUID, ...]:
    """Return the places that an operation puts something into, or takes it from."""
    match operation:
        case ops.Create():
            return (operation.parent_id,)
        case ops.TransferResource() | ops.Restore():
            ends = (operation.from_id, operation.to_id)
            named = {one for one in ends if not isinstance(one, msgspec.UnsetType)}
            return tuple(named - {operation.resource_id})
        case ops.Delete():
            return (operation.archive_id,)
        case _:
            return ()


def modes_of(
    operation: ops.Operation, targets: Iterable[UUID], kinds: Mapping[UUID, str]
) -> dict[UUID, UseMode]:
    """Return how an operation uses each resource.

    Args:
        operation: What is done.
        targets: What is used for it beside: devices, valves, what is heated.
        kinds: Kind of each resource, as far as it is known.
    """
    found = {
        node: UseMode.ALONE if keeps_matter(kinds.get(node, "")) else UseMode.USE
        for node in targets
    }
    places = places_of(operation)
    match operation:
        case ops.Read():
            found.setdefault(operation.device_id, UseMode.USE)
        case ops.TransferLiquid() | ops.TransferMass():
            is_stock = keeps_matter(kinds.get(operation.source_id, ""))
            found[operation.source_id] = UseMode.DRAW if is_stock else UseMode.ALONE
            is_waste = kinds.get(operation.target_id) == "waste"
            found[operation.target_id] = UseMode.POUR if is_waste else UseMode.ALONE
        case _:
            found |= dict.fromkeys(ops.touched_ids(operation), UseMode.ALONE)
            found |= {place: place_mode(kinds.get(place, "")) for place in places}
    return found


def merged(one: UseMode | None, other: UseMode) -> UseMode:
    """Return the mode that covers two uses of one thing."""
    return other if one in {None, other} else UseMode.ALONE


def clash(one: Modes, other: Modes, above: Above) -> UUID | None:
    """Return the first thing, in id order, that cannot be used in both ways; None: there is none.

    Args:
        one: What somebody uses, and how.
        other: What somebody else does.
        above: Everything above each of these.
    """
    wanted, held = with_above(one, above), with_above(other, above)
    for node in sorted(wanted.keys() & held.keys()):
        if any(excludes(a, b) for a in wanted[node] for b in held[node]):
            return node
    return None


def excludes(one: UseMode, other: UseMode) -> bool:
    """Say whether the same thing cannot be used by two in these ways."""
    return (one, other) not in _SHARED


def may_use_by_hand(operation: ops.Operation, *, is_holder: bool, is_quarantined: bool) -> bool:
    """Say whether a person may do by hand what a run holds something against.

    Who has started a run does by hand what it asks of a person, but takes nothing out of service
    under it. Taking stock of what is quarantined is what everybody waits for.

    Args:
        operation: What the person wants to do.
        is_holder: The person has started the run that holds it.
        is_quarantined: What the operation corrects is quarantined.
    """
    if isinstance(operation, ops.Correct) and is_quarantined:
        return True
    return is_holder and not isinstance(operation, ops.Delete | ops.Disconnect)


def with_above(modes: Modes, above: Above) -> dict[UUID, set[UseMode]]:
    """Return how things are used, and that something in what they stand in is."""
    found: dict[UUID, set[UseMode]] = {}
    for node, mode in modes.items():
        found.setdefault(node, set()).add(mode)
        for place in above.get(node, ()):
            found.setdefault(place, set()).add(UseMode.WITHIN)
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Party:
    """A run that has not ended, as far as holds are concerned."""

    id: UUID
    has_begun: bool
    """It holds something, or did."""

    held: Modes
    needs: Modes
    """All that it may still use, what it holds included."""

    choices: Sequence[Sequence[Modes]] = ()
    """For each action that several devices may do: what it takes on each, beside that."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldAsk:
    """What a run waits for."""

    run_id: UUID
    turn: tuple[float, int]
    """When it began to wait, and its number: the lower goes first."""

    wanted: Modes


class Why(StrEnum):
    """Why a run does not get what it asks for now."""

    HELD = "held"
    """The other run holds it."""

    TURN = "turn"
    """The other run has asked for it before."""

    UNSAFE = "unsafe"
    """With it, neither this run nor the other could end."""


@dataclass(frozen=True, slots=True)
class HoldRefusal:
    """For whom and for what a run waits."""

    why: Why
    run_id: UUID
    resource_id: UUID


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldScene:
    """All that decides about a grant."""

    parties: Sequence[Party]
    """Every run of the lab that has not ended, who asks included."""

    waiting: Sequence[HoldAsk] = ()
    """What others have asked for and not got."""

    above: Above = field(default_factory=dict)


def refusal(asker: Party, ask: HoldAsk, scene: HoldScene) -> HoldRefusal | None:
    """Decide whether a run may have what it asks for; None: it may.

    A run that has begun gets what is free as long as every run that has begun can still end. One
    that has not begun comes after those that wait for anything that it may need: so nobody is
    overtaken for ever, and no run that is under way is kept from its end by one that is not.

    Args:
        asker: The run.
        ask: What it asks for, all of it at once.
        scene: The other runs, and what they wait for.
    """
    others = [one for one in scene.parties if one.id != asker.id]
    for other in others:
        node = clash(ask.wanted, other.held, scene.above)
        if node is not None:
            return HoldRefusal(Why.HELD, other.id, node)
    if not asker.has_begun:
        needs = dict(asker.needs) | dict(ask.wanted)
        for before in _before(ask, scene.waiting):
            node = clash(needs, before.wanted, scene.above)
            if node is not None:
                return HoldRefusal(Why.TURN, before.run_id, node)
    after = Party(
        id=asker.id,
        has_begun=True,
        held=_both(asker.held, ask.wanted),
        needs=_both(asker.needs, ask.wanted),
        choices=asker.choices,
    )
    return _stuck(asker.id, [after, *(one for one in others if one.has_begun)], scene.above)


def _before(ask: HoldAsk, waiting: Iterable[HoldAsk]) -> list[HoldAsk]:
    earlier = (one for one in waiting if one.run_id != ask.run_id and one.turn < ask.turn)
    return sorted(earlier, key=lambda one: one.turn)


def _both(one: Modes, other: Modes) -> dict[UUID, UseMode]:
    found = dict(one)
    for node, mode in other.items():
        found[node] = merged(found.get(node), mode)
    return found


def _stuck(asker_id: UUID, begun: Collection[Party], above: Above) -> HoldRefusal | None:
    """Return who would keep whom from ending; None: there is an order in which all end."""
    left = list(begun)
    while left:
        able = next((one for one in left if _obstacle(one, left, above) is None), None)
        if able is None:
            return _named(asker_id, left, above)
        left.remove(able)
    return None


def _obstacle(party: Party, left: Iterable[Party], above: Above) -> tuple[UUID, UUID] | None:
    """Return the run and the thing that keep a run from ending while these hold what they do."""
    others = [one for one in left if one.id != party.id]
    found = _first_clash(party.needs, others, above)
    for ways in party.choices:
        if found is not None:
            break
        obstacles = [_first_clash(way, others, above) for way in ways]
        if obstacles and None not in obstacles:
            found = obstacles[0]
    return found


def _first_clash(needs: Modes, others: Iterable[Party], above: Above) -> tuple[UUID, UUID] | None:
    for other in others:
        node = clash(needs, other.held, above)
        if node is not None:
            return other.id, node
    return None


def _named(asker_id: UUID, left: Sequence[Party], above: Above) -> HoldRefusal:
    """Name another run of the ring, and what of it is in the way."""
    first = next((one for one in left if one.id == asker_id), left[0])
    found = _obstacle(first, left, above)
    if found is None or found[0] == asker_id:
        raise ValueError("a run that nothing keeps from ending is no ring")
    return HoldRefusal(Why.UNSAFE, *found)
