"""Read labware definitions of Opentrons, schema 2 and schema 3."""

from __future__ import annotations

import re
from collections.abc import Mapping

from labweb.domain.resources.labware.definition_check import check_definition
from labweb.domain.resources.labware.foreign_json import JsonReader, open_reader
from labweb.domain.resources.labware.labware_definition import (
    LabwareDefinition,
    TipDefinition,
    Vector,
    WellDefinition,
)
from labweb.domain.resources.labware.opentrons_seat import read_seat
from labweb.domain.resources.labware.opentrons_well import read_cavities
from labweb.domain.resources.labware.well_geometry import Cavity

MAX_WELLS = 10_000

VERSIONS = (2, 3)

_ADDRESS = re.compile(r"[A-Z]{1,3}[1-9][0-9]{0,3}")
_KINDS: Mapping[str, tuple[str, str | None]] = {
    "wellPlate": ("plate", "well"),
    "tipRack": ("tip_rack", "tip_spot"),
    "tubeRack": ("tube_rack", "tube"),
    "reservoir": ("reservoir", "trough"),
    "trash": ("waste", None),
    "lid": ("lid", None),
    "other": ("foreign", None),
    "system": ("foreign", None),
}
_BLOCKS = ("aluminumBlock", "adapter")


def is_opentrons(value: object) -> bool:
    """Tell whether decoded JSON is meant as such a definition."""
    return isinstance(value, Mapping) and "schemaVersion" in value and "wells" in value


def parse_opentrons(value: object) -> LabwareDefinition:
    """Read one labware definition.

    Args:
        value: The decoded JSON. Fields that say nothing of geometry, volume or stacking are
            not read.

    Raises:
        DefinitionError: `labware.invalid`; the findings name every field that is wrong.

    Source:
        opentrons-shared-data 10.1.0, `labware/schemas/2.json` and `3.json`. Schema 2 counts
        from the front left bottom corner, schema 3 from the back left bottom one.
    """
    reader = open_reader(value, "the labware definition")
    version = reader.value.get("schemaVersion")
    if version not in VERSIONS or isinstance(version, bool):
        reader.refuse("labware.version", f"is {version!r:.40}, not 2 or 3", "schemaVersion")
    reader.done("the labware definition")
    definition = _read(reader, 3 if version == 3 else 2)
    reader.done("the labware definition")
    layout = reader.optional_object("parameters").value.get("format")
    category = reader.optional_object("metadata").value.get("displayCategory")
    for field, problem in check_definition(
        definition, layout if isinstance(layout, str) else "", is_block=category in _BLOCKS
    ):
        reader.refuse("labware.contradiction", problem, field)
    reader.done("the labware definition")
    return definition


def _read(reader: JsonReader, version: int) -> LabwareDefinition:
    parameters = reader.optional_object("parameters")
    metadata = reader.optional_object("metadata")
    size, origin = _read_size(reader, version)
    cavities = read_cavities(reader)
    wells = _read_wells(reader, origin, cavities)
    kind, well_kind = _kind(reader, metadata, wells)
    is_rack = parameters.flag("isTiprack")
    if is_rack != (kind == "tip_rack"):
        parameters.refuse("labware.kind", "contradicts the category", "isTiprack")
    return LabwareDefinition(
        name=parameters.text("loadName"),
        label=metadata.text("displayName"),
        kind=kind,
        well_kind=well_kind,
        source=f"opentrons/{version}",
        size=size,
        wells=wells,
        tip=_read_tip(parameters, wells) if is_rack else None,
        seat=read_seat(reader, version, size, origin),
    )


def _read_size(reader: JsonReader, version: int) -> tuple[Vector, Vector]:
    """Return the size of the box around it, and its own origin seen from our corner."""
    if version == 2:
        box = reader.optional_object("dimensions")
        names = ("xDimension", "yDimension", "zDimension")
        return Vector(*(box.number(name) for name in names)), Vector(0.0, 0.0, 0.0)
    total = reader.optional_object("extents").optional_object("total")
    low, high = total.vector("backLeftBottom"), total.vector("frontRightTop")
    size = Vector(high.x_mm - low.x_mm, low.y_mm - high.y_mm, high.z_mm - low.z_mm)
    if min(size) < 0:
        total.refuse("labware.number", "is a box inside out")
    return size, Vector(0.0 - low.x_mm, 0.0 - high.y_mm, 0.0 - low.z_mm)


def _read_wells(
    reader: JsonReader, origin: Vector, cavities: Mapping[str, Cavity]
) -> tuple[WellDefinition, ...]:
    found = {
        address: _read_well(address, well, origin, cavities)
        for address, well in reader.entries("wells", MAX_WELLS)
    }
    order = _read_order(reader)
    if order is None:
        reader.refuse("labware.field", "is no list of columns of wells", "ordering")
    elif sorted(order) != sorted(found):
        odd = sorted(set(order) ^ set(found))[:5] or ["a well is named twice"]
        reader.refuse("labware.ordering", f"is no list of the wells: {', '.join(odd)}", "ordering")
    else:
        return tuple(found[address] for address in order)
    return ()


def _read_order(reader: JsonReader) -> list[str] | None:
    columns = reader.value.get("ordering")
    if not isinstance(columns, list) or not all(isinstance(column, list) for column in columns):
        return None
    order = [address for column in columns for address in column]
    return order if all(isinstance(address, str) for address in order) else None


def _read_well(
    address: str, well: JsonReader, origin: Vector, cavities: Mapping[str, Cavity]
) -> WellDefinition:
    if _ADDRESS.fullmatch(address) is None:
        well.refuse("labware.address", "is no address such as A1")
    is_round = well.choice("shape", ("circular", "rectangular")) == "circular"
    sides = ("diameter", "diameter") if is_round else ("xDimension", "yDimension")
    shape_id = well.text("geometryDefinitionId") if well.has("geometryDefinitionId") else None
    if shape_id is not None and shape_id not in cavities:
        well.refuse("labware.no_geometry", f"names the geometry {shape_id!r}, which is not there")
    own = Vector(*(well.number(axis, -1000.0) for axis in ("x", "y", "z")))
    return WellDefinition(
        address=address,
        bottom=own.plus(origin),
        x_size_mm=well.number(sides[0]),
        y_size_mm=well.number(sides[1]),
        depth_mm=well.number("depth"),
        is_round=is_round,
        capacity_nl=well.capacity_nl("totalLiquidVolume"),
        cavity=cavities.get(shape_id or ""),
    )


def _kind(
    reader: JsonReader, metadata: JsonReader, wells: tuple[WellDefinition, ...]
) -> tuple[str, str | None]:
    """Return the kinds of the labware and of what lies in it.

    A block or an adapter is a carrier when nothing in it holds liquid; else it is described
    together with the tubes or the plate in it, and counts as those.
    """
    category = metadata.choice("displayCategory", (*_KINDS, *_BLOCKS))
    if category not in _BLOCKS:
        return _KINDS.get(category, ("foreign", None))
    if not any(well.capacity_nl for well in wells):
        return "carrier", None
    groups = reader.objects("groups", MAX_WELLS)
    insides = {group.optional_object("metadata").value.get("displayCategory") for group in groups}
    return _KINDS["wellPlate" if "wellPlate" in insides else "tubeRack"]


def _read_tip(parameters: JsonReader, wells: tuple[WellDefinition, ...]) -> TipDefinition:
    capacities = {well.capacity_nl for well in wells}
    if len(capacities) > 1:
        parameters.refuse("labware.tips", "has tips of more than one volume")
    return TipDefinition(
        length_mm=parameters.number("tipLength"),
        overlap_mm=parameters.optional_number("tipOverlap"),
        capacity_nl=next(iter(capacities), None),
    )
