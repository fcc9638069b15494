"""Turn labware into resources: the labware itself, and each well with an identity of its own."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from uuid import UUID, uuid5

import msgspec

from labweb.domain.errors import DefinitionError, Finding
from labweb.domain.resources.exact_volumes import from_nl
from labweb.domain.resources.labware.labware_definition import (
    LabwareDefinition,
    TipDefinition,
    WellDefinition,
)
from labweb.domain.resources.labware.labware_parts import LabwarePart, definition_of
from labweb.domain.resources.labware.opentrons_deck import DeckDefinition, Slot
from labweb.domain.resources.labware.well_geometry import Cavity
from labweb.domain.resources.pose import Pose
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import KINDS

LONGEST_KEY = 500
"""Longest key of a resource."""

_LABWARE = frozenset({"plate", "tip_rack", "tube_rack", "reservoir"})
_INSIDE = frozenset({"well", "tube", "trough", "tip_spot", "tip"})
_UL = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class LabwareIdentity:
    """Under which name a piece of labware is known in its lab."""

    id: UUID
    key: str
    name: str
    parent_id: UUID | None


def well_id(labware_id: UUID, address: str) -> UUID:
    """Return the id of a well: the same labware and address always give the same one."""
    return uuid5(labware_id, address)


def tip_id(labware_id: UUID, address: str) -> UUID:
    """Return the id of the tip that a full rack brings at an address."""
    return uuid5(labware_id, f"{address}/tip")


def ids_in_labware(kinds: Mapping[str, str], ids: Mapping[str, UUID]) -> dict[str, UUID]:
    """Return, by key, the ids of what lies in labware, which are those of an import.

    Args:
        kinds: Kind of every resource of a file, by key.
        ids: Id of every resource, by key, labware among them.
    """
    found: dict[str, UUID] = {}
    for key, kind in kinds.items():
        if kind not in _INSIDE:
            continue
        labware, _, address = key.rpartition("/")
        if kind == "tip":
            labware, _, place = labware.rpartition("/")
            address = f"{place}/{address}"
        if kinds.get(labware) in _LABWARE:
            found[key] = uuid5(ids[labware], address)
    return found


def labware_resources(
    definition: LabwareDefinition,
    identity: LabwareIdentity,
    *,
    pose: Pose | None = None,
    has_tips: bool = False,
) -> tuple[Resource, ...]:
    """Return the labware and what lies in it, the labware first.

    Args:
        definition: What it is.
        identity: As what it is known.
        pose: Against its parent; None is unknown until somebody confirms it.
        has_tips: A person says that the rack is full, so that each place brings a tip. A
            definition never says whether it is.

    Raises:
        DefinitionError: `labware.invalid`: a key would be too long, or tips are asked of what
            is no tip rack.
    """
    _check(definition, identity, has_tips=has_tips)
    labware = Resource(
        id=identity.id,
        key=identity.key,
        name=identity.name,
        kind=definition.kind,
        nature=KINDS[definition.kind].nature,
        parent_id=identity.parent_id,
        pose=pose,
        size_mm=definition.size,
        config=_labware_config(definition),
    )
    inside: list[Resource] = []
    if definition.well_kind is not None:
        for well in definition.wells:
            inside.append(_well(definition, definition.well_kind, identity, well))
            if has_tips and definition.tip is not None:
                inside.append(_tip(definition.tip, identity, well))
    return (labware, *inside)


def _check(definition: LabwareDefinition, identity: LabwareIdentity, *, has_tips: bool) -> None:
    longest = max((len(well.address) for well in definition.wells), default=0)
    _check_identity(identity, longest + len("Tip  of "))
    if has_tips and definition.tip is None:
        finding = Finding("labware.tips", f"{definition.label} is no tip rack", "tips")
        raise DefinitionError(finding.message, code="labware.invalid", findings=[finding])


def _check_identity(identity: LabwareIdentity, room_count: int = 0) -> None:
    """Refuse a key or a name that is none, or that leaves no room for what lies in it."""
    findings = [
        Finding("labware.text", f"the {what} {text[:40]!r} is empty or cannot be printed", what)
        for what, text in (("key", identity.key), ("name", identity.name))
        if not text.strip() or not text.isprintable()
    ]
    if max(len(identity.key), len(identity.name)) + room_count > LONGEST_KEY:
        findings.append(Finding("labware.text", "key or name leaves no room for its wells", "key"))
    if findings:
        raise DefinitionError(findings[0].message, code="labware.invalid", findings=findings)


def _labware_config(definition: LabwareDefinition) -> dict[str, Any]:
    if definition.kind == "waste":
        return _vessel_config(sum(well.capacity_nl or 0 for well in definition.wells) or None)
    if definition.kind == "foreign":
        return {}
    config = {"definition": definition.name, "definition_format": definition.source}
    if definition.kind == "tube_rack" and definition.wells:
        return {**config, "sites_count": len(definition.wells)}
    return config


def _well(
    definition: LabwareDefinition, kind: str, identity: LabwareIdentity, well: WellDefinition
) -> Resource:
    return Resource(
        id=well_id(identity.id, well.address),
        key=f"{identity.key}/{well.address}",
        name=f"{identity.name} {well.address}",
        kind=kind,
        nature=KINDS[kind].nature,
        parent_id=identity.id,
        pose=Pose(*well.corner),
        size_mm=(well.x_size_mm, well.y_size_mm, well.depth_mm),
        config=_inside_config(kind, well, definition.tip),
    )


def _inside_config(kind: str, well: WellDefinition, tip: TipDefinition | None) -> dict[str, Any]:
    if kind == "tip_spot":
        return {} if tip is None else _spot_config(tip)
    if not KINDS[kind].holds_liquid:
        return {}
    return _cavity_config(well.capacity_nl, well.depth_mm, well.cavity, is_round=well.is_round)


def _vessel_config(capacity_nl: int | None) -> dict[str, Any]:
    return {"capacity_ul": from_nl(capacity_nl, _UL)} if capacity_nl else {}


def _cavity_config(
    capacity_nl: int | None, depth_mm: float, cavity: Cavity | None, *, is_round: bool
) -> dict[str, Any]:
    config = {**_vessel_config(capacity_nl), "is_round": is_round}
    if depth_mm > 0:
        config["depth_mm"] = depth_mm
    if cavity is not None:
        config["cavity"] = msgspec.json.decode(msgspec.json.encode(cavity))
    return config


def _spot_config(tip: TipDefinition) -> dict[str, Any]:
    config: dict[str, Any] = {"tip_length_mm": tip.length_mm}
    if tip.overlap_mm is not None:
        config["tip_overlap_mm"] = tip.overlap_mm
    if tip.capacity_nl is not None:
        config["tip_capacity_ul"] = from_nl(tip.capacity_nl, _UL)
    return config


def _tip(tip: TipDefinition, identity: LabwareIdentity, well: WellDefinition) -> Resource:
    config = _vessel_config(tip.capacity_nl)
    if tip.length_mm > 0:
        config["length_mm"] = tip.length_mm
    if tip.overlap_mm is not None:
        config["overlap_mm"] = tip.overlap_mm
    return Resource(
        id=tip_id(identity.id, well.address),
        key=f"{identity.key}/{well.address}/tip",
        name=f"Tip {well.address} of {identity.name}",
        kind="tip",
        nature=KINDS["tip"].nature,
        parent_id=well_id(identity.id, well.address),
        config=config,
    )


def part_resources(
    part: LabwarePart,
    identity: LabwareIdentity,
    id_of: Callable[[str], UUID],
    *,
    full_racks: Collection[str] = (),
) -> tuple[Resource, ...]:
    """Return a part and all below it, parents first.

    Plates and racks become what `labware_resources` makes of them, so that a well is keyed
    `plate/A1` whoever described it. All else is keyed by the outermost key and its own name.

    Args:
        part: The outermost part.
        identity: As what it is known.
        id_of: Gives the id to a key of this lab; what lies in labware has its id from that.
        full_racks: Names of the tip racks in it of which a person says that they are full.

    Raises:
        DefinitionError: `labware.invalid`: a piece of labware in it cannot be described.
    """
    root = _Root(identity.key, id_of, frozenset(full_racks))
    return tuple(_below(part, identity, root))


@dataclass(frozen=True, slots=True)
class _Root:
    key: str
    id_of: Callable[[str], UUID]
    full_racks: frozenset[str]

    def identity(self, part: LabwarePart, parent_id: UUID) -> LabwareIdentity:
        key = f"{self.key}/{part.name}"
        return LabwareIdentity(id=self.id_of(key), key=key, name=part.name, parent_id=parent_id)


def _below(part: LabwarePart, identity: LabwareIdentity, root: _Root) -> Iterator[Resource]:
    if part.kind in _LABWARE:
        has_tips = part.name in root.full_racks
        definition = definition_of(part)
        yield from labware_resources(definition, identity, pose=part.pose, has_tips=has_tips)
        apart = [child for child in part.children if child.kind == "lid"]
    else:
        yield _plain(part, identity)
        apart = list(part.children)
    for child in apart:
        yield from _below(child, root.identity(child, identity.id), root)


def _plain(part: LabwarePart, identity: LabwareIdentity) -> Resource:
    _check_identity(identity)
    return Resource(
        id=identity.id,
        key=identity.key,
        name=identity.name,
        kind=part.kind,
        nature=KINDS[part.kind].nature,
        parent_id=identity.parent_id,
        pose=part.pose,
        size_mm=part.size,
        config=_plain_config(part),
    )


def _plain_config(part: LabwarePart) -> Mapping[str, Any]:
    kind = part.kind
    if kind in ("carrier", "deck", "lid"):
        return {"definition": part.label, "definition_format": "pylabrobot"}
    if kind in ("well", "tube", "trough"):
        return _cavity_config(part.capacity_nl, part.size.z_mm, part.cavity, is_round=part.is_round)
    return _vessel_config(part.capacity_nl) if kind == "waste" else {}


def deck_resources(
    deck: DeckDefinition, identity: LabwareIdentity, id_of: Callable[[str], UUID]
) -> tuple[Resource, ...]:
    """Return a deck and its slots for labware, the deck first.

    Bins, chutes and module tops are things of their own and not part of the deck.
    """
    _check_identity(identity, max((len(name) for name in deck.slots), default=0) + len("/"))
    own = Resource(
        id=identity.id,
        key=identity.key,
        name=identity.name,
        kind="deck",
        nature=KINDS["deck"].nature,
        parent_id=identity.parent_id,
        size_mm=deck.size,
        config={"definition": deck.name, "definition_format": deck.source},
    )
    slots = [slot for slot in deck.slots.values() if slot.is_for_labware]
    return (own, *(_slot(deck, slot, identity, id_of) for slot in slots))


def _slot(
    deck: DeckDefinition, slot: Slot, identity: LabwareIdentity, id_of: Callable[[str], UUID]
) -> Resource:
    key = f"{identity.key}/{slot.name}"
    return Resource(
        id=id_of(key),
        key=key,
        name=f"{identity.name} {slot.name}",
        kind="slot",
        nature=KINDS["slot"].nature,
        parent_id=identity.id,
        pose=Pose(*slot.corner.minus(deck.corner)),
        size_mm=slot.size,
    )
