"""Definitions of Opentrons: read whole, or refused with every field that is wrong."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.errors import DefinitionError, NotFoundError
from labweb.domain.resources.labware.labware_definition import Vector
from labweb.domain.resources.labware.opentrons_labware import parse_opentrons
from labweb.domain.resources.labware.well_geometry import Conical, Table
from tests.domain.resources.labware_files import Json, a_v3_plate, an_opentrons_plate


def codes(value: object) -> dict[str, str]:
    """Return the code of each finding by what it is about."""
    with pytest.raises(DefinitionError) as refused:
        parse_opentrons(value)
    assert refused.value.code == "labware.invalid"
    return {finding.subject: finding.code for finding in refused.value.findings}


def changed(value: Json, path: str, new: object) -> Json:
    """Set one inner field."""
    *way, last = path.split(".")
    inner: Any = value
    for step in way:
        inner = inner[int(step)] if isinstance(inner, list) else inner[step]
    inner[last] = new
    return value


def test_a_plate_of_schema_2_is_read_whole() -> None:
    plate = parse_opentrons(an_opentrons_plate())
    assert (plate.name, plate.label, plate.source) == ("two_wells", "Two wells", "opentrons/2")
    assert (plate.kind, plate.well_kind) == ("plate", "well")
    assert [well.address for well in plate.wells] == ["A1", "B1"]
    assert plate.size == (40, 30, 14)
    assert plate.seat.corner_offset == (1, 2, 3)
    well = plate.find_well("B1")
    assert well.bottom == (10, 8, 2.5)
    assert well.top == (10, 8, 12.5)
    assert well.corner == (7, 5, 2.5)
    assert well.capacity_nl == 250_500
    cone = Conical(bottom_mm=0, top_mm=10, bottom_diameter_mm=4, top_diameter_mm=6)
    assert well.cavity == (cone,)
    with pytest.raises(NotFoundError):
        plate.find_well("C1")


def test_a_plate_of_schema_3_is_turned_to_the_front_left_corner() -> None:
    plate = parse_opentrons(a_v3_plate())
    assert plate.source == "opentrons/3"
    assert plate.size == (120, 80, 14)
    assert plate.find_well("A1").bottom == (14, 69, 3.5)
    assert plate.seat.footprint is not None
    assert (plate.seat.footprint.back_mm, plate.seat.footprint.front_mm) == (80, 0)
    assert plate.seat.origin == (0, 80, 0)


def test_measured_heights_are_taken_as_a_table() -> None:
    points = [{"height": 9.5, "volume": 200}, {"height": 4, "volume": 80.5}]
    value = an_opentrons_plate(innerLabwareGeometry={"cone": {"heightToVolumeMap": points}})
    (table,) = parse_opentrons(value).find_well("A1").cavity or ()
    assert isinstance(table, Table)
    assert table.points == ((0, 0), (4, 80.5), (9.5, 200))


def test_a_tip_rack_tells_its_tips() -> None:
    parameters = {"isTiprack": True, "loadName": "rack", "tipLength": 50, "tipOverlap": 7.5}
    metadata = {"displayName": "Rack", "displayCategory": "tipRack"}
    rack = parse_opentrons(an_opentrons_plate(parameters=parameters, metadata=metadata))
    assert (rack.kind, rack.well_kind) == ("tip_rack", "tip_spot")
    assert rack.tip is not None
    assert (rack.tip.length_mm, rack.tip.overlap_mm) == (50, 7.5)
    assert rack.tip.capacity_nl == 250_500


@pytest.mark.parametrize(
    ("group", "kind", "well_kind"),
    [("tubeRack", "tube_rack", "tube"), ("wellPlate", "plate", "well")],
)
def test_a_block_counts_as_what_stands_in_it(group: str, kind: str, well_kind: str) -> None:
    value = changed(an_opentrons_plate(), "metadata.displayCategory", "aluminumBlock")
    value["groups"] = [{"metadata": {"displayCategory": group}, "wells": []}]
    block = parse_opentrons(value)
    assert (block.kind, block.well_kind) == (kind, well_kind)


def test_an_adapter_that_holds_no_liquid_is_a_carrier() -> None:
    value = changed(an_opentrons_plate(), "metadata.displayCategory", "adapter")
    for well in value["wells"].values():
        well["totalLiquidVolume"] = 0
    adapter = parse_opentrons(value)
    assert (adapter.kind, adapter.well_kind) == ("carrier", None)


@pytest.mark.parametrize(
    ("path", "new", "subject", "code"),
    [
        ("schemaVersion", 1, "schemaVersion", "labware.version"),
        ("schemaVersion", True, "schemaVersion", "labware.version"),
        ("schemaVersion", None, "schemaVersion", "labware.version"),
        ("wells", [], "wells", "labware.field"),
        ("wells.A1", 7, "wells.A1", "labware.field"),
        ("wells.A1.x", math.nan, "wells.A1.x", "labware.number"),
        ("wells.A1.x", math.inf, "wells.A1.x", "labware.number"),
        ("wells.A1.x", 10**400, "wells.A1.x", "labware.number"),
        ("wells.A1.x", "10", "wells.A1.x", "labware.field"),
        ("wells.A1.x", True, "wells.A1.x", "labware.field"),
        ("wells.A1.depth", -1, "wells.A1.depth", "labware.number"),
        ("wells.A1.depth", None, "wells.A1.depth", "labware.missing"),
        ("wells.A1.shape", "hexagonal", "wells.A1.shape", "labware.choice"),
        ("wells.A1.diameter", None, "wells.A1.diameter", "labware.missing"),
        ("wells.A1.totalLiquidVolume", -3, "wells.A1.totalLiquidVolume", "labware.number"),
        ("wells.A1.totalLiquidVolume", 0.0004, "wells.A1.totalLiquidVolume", "labware.amount"),
        ("wells.A1.geometryDefinitionId", "egg", "wells.A1", "labware.no_geometry"),
        ("ordering", [["A1"]], "ordering", "labware.ordering"),
        ("ordering", [["A1", "B1"], ["A1"]], "ordering", "labware.ordering"),
        ("ordering", "A1", "ordering", "labware.field"),
        ("metadata.displayCategory", "spaceship", "metadata.displayCategory", "labware.choice"),
        ("metadata.displayName", "", "metadata.displayName", "labware.text"),
        ("metadata.displayName", "a\nb", "metadata.displayName", "labware.text"),
        ("parameters.loadName", "x" * 201, "parameters.loadName", "labware.text"),
        ("parameters.isTiprack", True, "parameters.isTiprack", "labware.kind"),
        ("cornerOffsetFromSlot", None, "cornerOffsetFromSlot", "labware.missing"),
        ("dimensions", {}, "dimensions.xDimension", "labware.missing"),
        (
            "innerLabwareGeometry.cone.sections.0.shape",
            "bowl",
            "innerLabwareGeometry.cone.sections[0].shape",
            "labware.choice",
        ),
        (
            "innerLabwareGeometry.cone.sections.0.bottomHeight",
            3,
            "innerLabwareGeometry.cone",
            "labware.geometry",
        ),
        (
            "innerLabwareGeometry.cone.sections.0.xCount",
            0,
            "innerLabwareGeometry.cone.sections[0].xCount",
            "labware.number",
        ),
    ],
)
def test_a_wrong_field_is_named(path: str, new: object, subject: str, code: str) -> None:
    assert codes(changed(an_opentrons_plate(), path, new)).get(subject) == code


def test_all_that_is_wrong_is_told_at_once() -> None:
    value = changed(an_opentrons_plate(), "wells.A1.x", None)
    value = changed(value, "wells.B1.depth", "deep")
    found = codes(changed(value, "dimensions.zDimension", -4))
    assert {"wells.A1.x", "wells.B1.depth", "dimensions.zDimension"} <= set(found)


def test_a_rack_of_two_kinds_of_tips_is_refused() -> None:
    parameters = {"isTiprack": True, "loadName": "rack", "tipLength": 50}
    metadata = {"displayName": "Rack", "displayCategory": "tipRack"}
    value = an_opentrons_plate(parameters=parameters, metadata=metadata)
    assert codes(changed(value, "wells.A1.totalLiquidVolume", 7)) == {"parameters": "labware.tips"}


def test_a_spring_that_pushes_elsewhere_is_refused() -> None:
    value = changed(
        a_v3_plate(), "features.slotFootprintAsChild.springDirectionalForce", "frontRight"
    )
    subject = "features.slotFootprintAsChild.springDirectionalForce"
    assert codes(value) == {subject: "labware.choice"}


def test_a_geometry_with_more_sections_than_any_well_needs_is_refused() -> None:
    value = an_opentrons_plate(innerLabwareGeometry={"cone": {"sections": [{}] * 1001}})
    subject = "innerLabwareGeometry.cone.sections"
    assert codes(value)[subject] == "labware.too_many"


def test_an_address_that_is_none_is_refused() -> None:
    value = an_opentrons_plate(ordering=[["first"]])
    value["wells"] = {"first": value["wells"]["A1"]}
    assert codes(value) == {"wells.first": "labware.address"}


def test_too_many_wells_are_not_even_read() -> None:
    value = an_opentrons_plate()
    value["wells"] = {f"A{n}": {} for n in range(1, 10_002)}
    found = codes(value)
    assert found["wells"] == "labware.too_many"


def test_a_box_inside_out_is_refused() -> None:
    value = changed(a_v3_plate(), "extents.total.frontRightTop.y", 80)
    assert codes(value)["extents.total"] == "labware.number"


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=8,
)


@given(st.data(), _JSON)
def test_no_value_in_any_place_is_met_with_anything_but_a_definition_error(
    data: st.DataObject, new: object
) -> None:
    base: Json = an_opentrons_plate() if data.draw(st.booleans()) else a_v3_plate()
    place: Any = base
    for _ in range(data.draw(st.integers(0, 4))):
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        key = data.draw(st.sampled_from(keys))
        if not isinstance(place[key], dict | list) or not place[key]:
            break
        place = place[key]
    keys = list(place) if isinstance(place, dict) else list(range(len(place)))
    place[data.draw(st.sampled_from(keys))] = new
    try:
        definition = parse_opentrons(base)
    except DefinitionError:
        return
    numbers = [*definition.size, *(part for well in definition.wells for part in well.bottom)]
    assert all(math.isfinite(number) for number in numbers)
    assert all(isinstance(well.bottom, Vector) for well in definition.wells)
