"""Read deck definitions of Opentrons: where each slot lies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from labweb.domain.errors import NotFoundError
from labweb.domain.resources.labware.foreign_json import FARTHEST_MM, JsonReader, open_reader
from labweb.domain.resources.labware.labware_definition import ZERO, Footprint, Vector

MAX_PLACES = 10_000

VERSIONS = (4, 5)

_BACK_LEFT = [-1, 1, -1]
_FOR_LABWARE = ("slot", "stagingSlot")
_AXES = ("xDimension", "yDimension", "zDimension")


@dataclass(frozen=True, slots=True, kw_only=True)
class Slot:
    """A fixed place on a deck."""

    name: str
    corner: Vector
    """Front left bottom, in the frame of the deck."""

    size: Vector
    footprint: Footprint
    """The rectangle that labware stands on, from the corner of the slot."""

    is_for_labware: bool = True
    """Labware stands on it; else it is a bin, a chute or the top of a module."""


@dataclass(frozen=True, kw_only=True)
class DeckDefinition:
    """A deck and its slots. Positions count from the front left corner of its first slot."""

    name: str
    label: str
    source: str
    size: Vector
    corner: Vector
    """Front left bottom corner of the deck, from that of its first slot."""

    slots: Mapping[str, Slot]

    def find_slot(self, name: str) -> Slot:
        """Return the slot.

        Raises:
            NotFoundError: The deck has no such slot.
        """
        if name not in self.slots:
            raise NotFoundError(f"{self.label} has no slot {name!r}", code="labware.no_slot")
        return self.slots[name]


def is_opentrons_deck(value: object) -> bool:
    """Tell whether decoded JSON is meant as a deck definition."""
    return isinstance(value, Mapping) and "cutoutFixtures" in value


def parse_opentrons_deck(value: object) -> DeckDefinition:
    """Read a deck definition: every addressable area at each cutout that a fixture gives it.

    Raises:
        DefinitionError: `labware.invalid`; the findings name every field that is wrong.

    Source:
        opentrons-shared-data 10.1.0, `deck/schemas/4.json` and `5.json`.
    """
    reader = open_reader(value, "the deck definition")
    version = reader.value.get("schemaVersion")
    if version not in VERSIONS or isinstance(version, bool):
        reader.refuse("labware.version", f"is {version!r:.40}, not 4 or 5", "schemaVersion")
    reader.done("the deck definition")
    locations = reader.optional_object("locations")
    cutouts = {
        cutout.text("id"): _triple(cutout, "position")
        for cutout in locations.objects("cutouts", MAX_PLACES)
    }
    areas = {area.text("id"): area for area in locations.objects("addressableAreas", MAX_PLACES)}
    slots: dict[str, Slot] = {}
    for fixture in reader.objects("cutoutFixtures", MAX_PLACES):
        for cutout, name in _provided(fixture):
            if cutout not in cutouts or name not in areas:
                fixture.refuse("labware.deck", f"joins {name!r} to {cutout!r}: one is not there")
            elif _slot(name, areas[name], cutouts[cutout]) != slots.setdefault(
                name, _slot(name, areas[name], cutouts[cutout])
            ):
                fixture.refuse("labware.deck", f"puts {name!r} at a second place")
    size, corner = _triple(reader, "dimensions"), _triple(reader, "cornerOffsetFromOrigin")
    name, label = reader.text("otId"), reader.optional_object("metadata").text("displayName")
    reader.done("the deck definition")
    return DeckDefinition(
        name=name,
        label=label,
        source=f"opentrons-deck/{version}",
        size=size,
        corner=corner,
        slots=slots,
    )


def _provided(fixture: JsonReader) -> list[tuple[str, str]]:
    provided = fixture.optional_object("providesAddressableAreas").value
    if not all(isinstance(names, list) for names in provided.values()):
        fixture.refuse("labware.field", "is no list of areas by cutout", "providesAddressableAreas")
        return []
    return [(cutout, str(name)) for cutout, names in provided.items() for name in names]


def _triple(reader: JsonReader, key: str) -> Vector:
    found = reader.value.get(key)
    if not isinstance(found, list) or len(found) != 3:
        reader.refuse("labware.field", "is no list of three numbers", key)
        return ZERO
    by_place = JsonReader(
        dict(zip("xyz", found, strict=True)), f"{reader.path}.{key}", reader.findings
    )
    return Vector(*(by_place.number(axis, -FARTHEST_MM) for axis in "xyz"))


def _slot(name: str, area: JsonReader, cutout: Vector) -> Slot:
    box = area.optional_object("boundingBox")
    size = Vector(*(box.number(axis) for axis in _AXES))
    return Slot(
        name=name,
        corner=cutout.plus(_triple(area, "offsetFromCutoutFixture")),
        size=size,
        footprint=Footprint(
            left_mm=0.0,
            back_mm=size.y_mm,
            right_mm=size.x_mm,
            front_mm=0.0,
            z_mm=0.0,
            is_pushed_to_back_left=area.value.get("matingSurfaceUnitVector") == _BACK_LEFT,
        ),
        is_for_labware=area.text("areaType") in _FOR_LABWARE,
    )
