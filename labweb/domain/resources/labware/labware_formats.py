"""Tell the formats of labware apart, and turn a file of any of them into resources."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from uuid import UUID

from labweb.domain.errors import DefinitionError, Finding
from labweb.domain.resources.labware.labware_definition import LabwareDefinition
from labweb.domain.resources.labware.labware_parts import LabwarePart, walk
from labweb.domain.resources.labware.labware_resources import (
    LabwareIdentity,
    deck_resources,
    labware_resources,
    part_resources,
)
from labweb.domain.resources.labware.opentrons_deck import (
    DeckDefinition,
    is_opentrons_deck,
    parse_opentrons_deck,
)
from labweb.domain.resources.labware.opentrons_labware import is_opentrons, parse_opentrons
from labweb.domain.resources.labware.pylabrobot import is_pylabrobot, parse_pylabrobot
from labweb.domain.resources.resource import Resource


@dataclass(frozen=True, kw_only=True)
class LabwareFile:
    """What a file describes."""

    format: str
    label: str
    content: LabwareDefinition | DeckDefinition | LabwarePart
    notes: tuple[Finding, ...] = ()


def read_labware(value: object) -> LabwareFile:
    """Read a definition or a deck of Opentrons, or a resource of PyLabRobot.

    Args:
        value: The decoded JSON.

    Raises:
        DefinitionError: `labware.unknown_format`, or as the reader of its format.
    """
    if is_opentrons(value):
        labware = parse_opentrons(value)
        return LabwareFile(format=labware.source, label=labware.label, content=labware)
    if is_opentrons_deck(value):
        deck = parse_opentrons_deck(value)
        return LabwareFile(format=deck.source, label=deck.label, content=deck)
    if is_pylabrobot(value):
        part, notes = parse_pylabrobot(value)
        return LabwareFile(format="pylabrobot", label=part.label, content=part, notes=tuple(notes))
    raise DefinitionError(
        "the file is no labware definition or deck of Opentrons and no resource of PyLabRobot",
        code="labware.unknown_format",
    )


def resources_of(
    file: LabwareFile,
    identity: LabwareIdentity,
    id_of: Callable[[str], UUID],
    *,
    is_full: bool = False,
) -> tuple[Resource, ...]:
    """Return the resources that a file describes, parents first.

    Args:
        file: What was read.
        identity: As what the outermost of them is known.
        id_of: Gives the id to a key of this lab.
        is_full: A person says that every tip rack in the file is full.

    Raises:
        DefinitionError: `labware.invalid`: something in it cannot become a resource.
    """
    match file.content:
        case LabwareDefinition() as labware:
            return labware_resources(labware, identity, has_tips=is_full)
        case DeckDefinition() as deck:
            if is_full:
                finding = Finding("labware.tips", f"{deck.label} is no tip rack", "tips")
                raise DefinitionError(finding.message, code="labware.invalid", findings=[finding])
            return deck_resources(deck, identity, id_of)
        case LabwarePart() as part:
            racks = [found.name for found, _ in walk(part) if found.kind == "tip_rack"]
            return part_resources(part, identity, id_of, full_racks=racks if is_full else ())
