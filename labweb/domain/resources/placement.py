"""What may stand in or on each kind of place, and how much of it: one table, one rule."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol
from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.resources.resource_kinds import KINDS, Nature
from labweb.domain.resources.resource_tree import Tree


class StandingThing(Protocol):
    """A thing, or a place, as far as the rule looks at it."""

    @property
    def name(self) -> str:
        """What a person reads."""

    @property
    def kind(self) -> str:
        """One of `KINDS`."""


@dataclass(frozen=True, slots=True)
class PlacedThing:
    """The least that the rule needs to know of what stands somewhere."""

    id: UUID
    name: str
    kind: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceRoom:
    """What a kind of place takes."""

    takes: frozenset[str]
    """Kinds of what may be put there, and taken away again."""

    has: frozenset[str] = frozenset()
    """Kinds of its own parts, which take nobody's place: the wells of a plate."""

    at_most: int | None = None
    """Most things at a time, parts not counted. None: as many as a person finds room for."""

    alone: frozenset[str] = frozenset()
    """Kinds of what needs the whole place: nothing stands beside it."""

    is_divided: bool = False
    """Where it has slots, or a tray of its own, things stand in these, and none beside them."""

    @property
    def is_bounded(self) -> bool:
        """Tell whether what stands there already has a say."""
        return self.at_most is not None or bool(self.alone) or self.is_divided


_DEVICES = frozenset(name for name, kind in KINDS.items() if kind.nature is not Nature.RESOURCE)
_LABWARE = frozenset({"plate", "tip_rack", "tube_rack", "reservoir"})
_VESSELS = frozenset(
    {"trough", "tube", "bottle", "flask", "vial", "vessel", "reactor", "separator", "filter"}
    | {"waste"}
)
_LOOSE = _VESSELS | {"cartridge", "tip", "lid", "sample_loop", "foreign"}
_MOVED = _LABWARE | _LOOSE | {"carrier"}
_SLOTS = frozenset({"slot"})
_DIVIDING = frozenset({"slot", "carrier"})
_BUILT_IN = frozenset({"well", "tip_spot"})
"""Never without the labware that they are a part of."""

_ANYTHING = frozenset(KINDS) - {"lab"} - _BUILT_IN
_NOTHING = PlaceRoom(takes=frozenset())
_ONE_ON_TOP = PlaceRoom(takes=_MOVED, has=_SLOTS | _DEVICES, at_most=1, is_divided=True)
_CHAMBER = PlaceRoom(takes=_MOVED, has=_SLOTS | _DEVICES, is_divided=True)
_TRAYS = PlaceRoom(takes=_MOVED, has=_SLOTS | _DEVICES | {"carrier"}, is_divided=True)
_LID = frozenset({"lid"})

PLACES: Mapping[str, PlaceRoom] = {
    **dict.fromkeys((name for name, kind in KINDS.items() if not kind.is_place), _NOTHING),
    "lab": PlaceRoom(takes=_ANYTHING),
    "site": PlaceRoom(takes=_ANYTHING - {"site"}),
    "room": PlaceRoom(takes=_ANYTHING - {"site", "room"}),
    "bench": PlaceRoom(takes=_ANYTHING - {"site", "room"}),
    "workstation": PlaceRoom(takes=_ANYTHING - {"site", "room"}),
    "archive": PlaceRoom(takes=frozenset(KINDS) - {"lab"}),
    "foreign": PlaceRoom(takes=_ANYTHING | _BUILT_IN),
    "deck": PlaceRoom(takes=_DEVICES | {"carrier", "waste", "foreign"}, has=_SLOTS | {"deck"}),
    "slot": PlaceRoom(takes=_MOVED | _DEVICES, at_most=1),
    "carrier": PlaceRoom(takes=_MOVED, has=_SLOTS, alone=_LABWARE | {"carrier"}, is_divided=True),
    "storage": PlaceRoom(takes=_MOVED, has=_SLOTS, is_divided=True),
    "plate": PlaceRoom(takes=_LID, has=frozenset({"well"}), at_most=1),
    "tip_rack": PlaceRoom(takes=_LID, has=frozenset({"tip_spot"}), at_most=1),
    "tip_spot": PlaceRoom(takes=frozenset({"tip"}), at_most=1),
    "tube_rack": PlaceRoom(
        takes=_VESSELS - {"trough", "reactor", "separator", "filter", "waste"} | {"foreign"}
    ),
    "reservoir": PlaceRoom(takes=_LID, has=frozenset({"trough"}), at_most=1),
    "pipette_channel": PlaceRoom(takes=frozenset({"tip"}), at_most=1),
    **dict.fromkeys(("heater_stirrer", "heater", "stirrer", "thermostat"), _ONE_ON_TOP),
    **dict.fromkeys(("shaker", "plate_reader", "spectrometer"), _ONE_ON_TOP),
    **dict.fromkeys(("gripper", "arm", "gantry"), _ONE_ON_TOP),
    **dict.fromkeys(("furnace", "battery_tester"), _CHAMBER),
    **dict.fromkeys(("chromatography", "analyser"), _TRAYS),
    "balance": PlaceRoom(takes=_MOVED | _DEVICES, at_most=1),
    "phase_separator": PlaceRoom(takes=_VESSELS | {"foreign"}, has=_SLOTS | _DEVICES, at_most=1),
    "rotary_evaporator": PlaceRoom(takes=_VESSELS | {"foreign"}, has=_DEVICES, at_most=2),
    "injection_valve": PlaceRoom(takes=frozenset({"sample_loop"}), at_most=2),
    "liquid_handler": PlaceRoom(
        takes=_DEVICES | {"carrier", "waste", "foreign"}, has=_SLOTS | {"deck"}
    ),
    "powder_dispenser": PlaceRoom(takes=_MOVED, has=_SLOTS | _DEVICES, at_most=2, is_divided=True),
    "agv": PlaceRoom(takes=_MOVED, has=_SLOTS | _DEVICES | {"deck", "storage"}, is_divided=True),
}
"""What each kind of place takes. A kind that is no place takes nothing."""

_SITES = frozenset({"carrier", "tube_rack"})
"""Kinds whose configuration may say how many sites they have, one for each thing."""


def is_bounded(kind: str) -> bool:
    """Tell whether what stands in a place of this kind has a say in what may come."""
    room = PLACES.get(kind)
    return room is not None and (room.is_bounded or kind in _SITES)


def sites_of(config: Mapping[str, object]) -> int | None:
    """Return how many sites a rack or a carrier has; None: nobody stated it."""
    count = config.get("sites_count")
    return count if isinstance(count, int) and not isinstance(count, bool) else None


def check_standing(
    thing: StandingThing,
    place: StandingThing,
    there: Collection[StandingThing],
    sites: int | None = None,
) -> list[Finding]:
    """List all that speaks against a thing's standing in a place; an empty list means it may.

    Args:
        thing: What is to stand there.
        place: Where.
        there: All that stands there now, the thing itself not among them.
        sites: How many things a rack or a carrier takes; None: nobody stated it.
    """
    room = PLACES.get(place.kind, _NOTHING)
    if thing.kind not in room.takes | room.has:
        return [_wrong_kind(thing, place, room)]
    if thing.kind in room.has:
        return []
    loose = [one for one in there if one.kind not in room.has]
    if room.is_divided and any(one.kind in room.has & _DIVIDING for one in there):
        text = (
            f"{thing.name} cannot stand in {place.name} itself, which has places of its own: "
            "put it in one of them"
        )
        return [Finding("place.not_in_slot", text, place.name, {"place": place.name})]
    in_the_way = _in_the_way(thing, room, loose, sites)
    if in_the_way is None:
        return []
    return [_occupied(thing, place, loose, in_the_way)]


def _in_the_way(
    thing: StandingThing, room: PlaceRoom, loose: Sequence[StandingThing], sites: int | None
) -> str | None:
    """Say what the place takes at most, where that is reached; None: there is room."""
    if room.at_most is not None and len(loose) >= room.at_most:
        return f"{_count(room.at_most)} at a time"
    if sites is not None and len(loose) >= sites:
        return f"{_count(sites)}, one on each of its sites"
    if loose and (thing.kind in room.alone or any(one.kind in room.alone for one in loose)):
        return "one piece of labware and nothing beside it"
    return None


def _count(number: int) -> str:
    return {1: "one thing", 2: "two things"}.get(number, f"{number} things")


def _occupied(
    thing: StandingThing, place: StandingThing, loose: Sequence[StandingThing], in_the_way: str
) -> Finding:
    names = ", ".join(one.name for one in loose[:3])
    more = f" and {len(loose) - 3} more" if len(loose) > 3 else ""
    verb = "stands" if len(loose) == 1 else "stand"
    text = (
        f"{thing.name} cannot stand in {place.name}: it takes {in_the_way}, and {names}{more} "
        f"{verb} there. Take {'that' if len(loose) == 1 else 'one'} away first, or choose "
        "another place"
    )
    context = {"place": place.name, "there": [one.name for one in loose[:100]]}
    return Finding("place.occupied", text, place.name, context)


def _wrong_kind(thing: StandingThing, place: StandingThing, room: PlaceRoom) -> Finding:
    what, where = _label(thing.kind), _label(place.kind)
    if thing.kind in _BUILT_IN:
        text = (
            f"{thing.name} is a {what}, which is a part of its labware and stands nowhere else: "
            "create the labware with its definition"
        )
    elif not room.takes and not room.has:
        text = f"{thing.name} cannot stand in {place.name}: a {where} carries nothing"
        return Finding("crutd.no_place", text, place.name)
    else:
        kinds = sorted(_label(kind) for kind in room.takes | room.has)
        told = ", ".join(kinds) if len(kinds) <= _MOST_TOLD else _hint(place.kind)
        text = f"{thing.name} is a {what} and cannot stand in {place.name}: a {where} takes {told}"
    return Finding("place.wrong_kind", text, place.name, {"place": place.name, "kind": thing.kind})


_MOST_TOLD = 4


def _hint(kind: str) -> str:
    if kind in {"deck", "liquid_handler"}:
        return "its own slots, and labware and vessels stand in these"
    return "other things: choose a slot, a bench or another place"


def _label(kind: str) -> str:
    found = KINDS.get(kind)
    return kind if found is None else found.label.lower()


def check_places(tree: Tree) -> Iterator[Finding]:
    """Yield what stands where it cannot, by node: each thing that comes after there is no room."""
    for place in tree.resources:
        children = tree.children.get(place.id, ())
        room = PLACES.get(place.kind, _NOTHING)
        parts = [one for one in children if one.kind in room.has]
        slots = [one for one in parts if one.kind in _DIVIDING][:1]
        there: list[StandingThing] = [*slots]
        bounded = is_bounded(place.kind)
        for child in children:
            for finding in check_standing(child, place, there, sites_of(place.config)):
                about = {**finding.context, "field": "parent"}
                yield Finding(finding.code, finding.message, child.key, about)
            if bounded and child.kind not in room.has:
                there.append(child)


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A place with all that stands in it, where that has a say."""

    thing: PlacedThing
    there: tuple[PlacedThing, ...] = ()
    sites_count: int | None = None


def check_arriving(
    arriving: Iterable[tuple[PlacedThing, UUID]], places: Iterable[Place]
) -> list[Finding]:
    """List all that speaks against things that come together, such as a device's parts.

    Args:
        arriving: Each with that in which it is to stand, which may be one that comes before it.
        places: Those that are there already; what goes into any other place is not judged.
    """
    known = {
        place.thing.id: (place.thing, list(place.there), place.sites_count) for place in places
    }
    findings: list[Finding] = []
    for thing, parent_id in arriving:
        if parent_id in known:
            place, there, sites_count = known[parent_id]
            findings += check_standing(thing, place, there, sites_count)
            if is_bounded(place.kind):
                there.append(thing)
        known[thing.id] = (thing, [], None)
    return findings
