"""Follow a published protocol far enough to know where each of its labware stands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from labweb.domain.resources.labware.labware_definition import LabwareDefinition, Vector
from labweb.domain.resources.labware.labware_pose import (
    Module,
    WellAnchor,
    find_corner,
    well_position,
)
from labweb.domain.resources.labware.opentrons_deck import (
    DeckDefinition,
    Slot,
    parse_opentrons_deck,
)
from labweb.domain.resources.labware.opentrons_labware import parse_opentrons
from labweb.domain.resources.pose import Pose
from tests.domain.resources.labware_files import OPENTRONS, Json, load

ANALYSES = sorted((OPENTRONS / "analysis").glob("*.analysis.json.gz"))

AT_WELLS = {"pickUpTip", "aspirate", "dispense", "dropTip"}

_DECKS = {"OT-2 Standard": "v5_ot2_standard", "OT-3 Standard": "v5_ot3_standard"}
_TRASH = "opentrons/opentrons_1_trash_1100ml_fixed/1"


def deck_of(robot: str) -> DeckDefinition:
    """The deck of a robot."""
    return parse_opentrons_deck(load(OPENTRONS / f"deck/{_DECKS[robot]}.json"))


@dataclass
class Bench:
    """Where things stand while a protocol runs."""

    protocol: Json
    deck: DeckDefinition
    modules: Mapping[str, Vector]
    """Offset of each model from its slot, as the engine reports it."""

    places: dict[str, Json | str] = field(
        default_factory=lambda: {"fixedTrash": {"slotName": "12"}}
    )
    names: dict[str, str] = field(default_factory=lambda: {"fixedTrash": _TRASH})
    standing: dict[str, tuple[str, Slot]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Put the bin where this robot has it, for it is never loaded."""
        self.places["fixedTrash"] = {"slotName": "12"}
        self.names["fixedTrash"] = _TRASH

    @cached_property
    def definitions(self) -> dict[str, LabwareDefinition]:
        """Every definition of the file, read by us."""
        found = self.protocol["labwareDefinitions"]
        return {uri: parse_opentrons(value) for uri, value in found.items()}

    def follow(self, command: Json) -> None:
        """Take in what a command does to the deck."""
        told = command["params"]
        match command["commandType"]:
            case "loadModule":
                own = self.protocol.get("modules", {}).get(told["moduleId"], told)
                slot = self.deck.find_slot(told["location"]["slotName"])
                self.standing[told["moduleId"]] = (own["model"], slot)
            case "loadLabware":
                own = self.protocol.get("labware", {}).get(told["labwareId"])
                version = f"{told.get('namespace')}/{told.get('loadName')}/{told.get('version')}"
                self.names[told["labwareId"]] = version if own is None else own["definitionId"]
                self.places[told["labwareId"]] = told["location"]
            case "moveLabware":
                self.places[told["labwareId"]] = told["newLocation"]

    def corner(self, labware_id: str) -> Vector:
        """Return where labware stands now."""
        stack: list[LabwareDefinition] = []
        place: Any = {"labwareId": labware_id}
        while "labwareId" in place:
            stack.insert(0, self.definitions[self.names[place["labwareId"]]])
            place = self.places[place["labwareId"]]
        if "moduleId" in place:
            model, slot = self.standing[place["moduleId"]]
            return find_corner(stack, slot, Module(model=model, offset=self.modules[model]))
        name = place.get("slotName") or place["addressableAreaName"]
        return find_corner(stack, self.deck.find_slot(name))

    def target(self, told: Json) -> Vector:
        """Return where a pipette goes for a command at a well."""
        labware = self.definitions[self.names[told["labwareId"]]]
        where = told.get("wellLocation") or {}
        offset = Vector(*(float(where.get("offset", {}).get(axis, 0)) for axis in "xyz"))
        origin = where.get("origin", "top")
        anchor = WellAnchor.TOP if origin == "default" else WellAnchor(origin)
        well = labware.find_well(told["wellName"])
        return well_position(Pose(*self.corner(told["labwareId"])), well, anchor, offset)


def pairs(protocol: Json, analysis: Json) -> Iterator[tuple[Json, Json]]:
    """Yield each command of the file with what the engine made of it, up to its first failure.

    The engine adds commands of its own and blackens ids, so kind and well are matched in order.
    """
    made = iter(analysis["commands"])
    for command in protocol["commands"]:
        key = (command["commandType"], command["params"].get("wellName"))
        for answer in made:
            if (answer["commandType"], answer["params"].get("wellName")) == key:
                yield command, answer
                break
        else:
            return


def module_offsets(analysis: Json) -> dict[str, Vector]:
    """Return the offset of each module in the place where the engine loaded it."""
    found = {}
    for command in analysis["commands"]:
        if command["commandType"] == "loadModule":
            definition = command["result"]["definition"]
            offset = definition["labwareOffset"]
            found[definition["model"]] = Vector(*(float(offset[axis]) for axis in "xyz"))
    return found
