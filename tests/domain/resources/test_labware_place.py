"""Where labware stands: on a slot, on a module, on other labware, turned."""

from __future__ import annotations

import math

import pytest

from labweb.domain.errors import DefinitionError, InfeasibleError, NotFoundError
from labweb.domain.resources.labware.labware_definition import Footprint, LabwareDefinition, Vector
from labweb.domain.resources.labware.labware_pose import (
    Module,
    WellAnchor,
    find_corner,
    well_position,
)
from labweb.domain.resources.labware.opentrons_deck import Slot, parse_opentrons_deck
from labweb.domain.resources.labware.opentrons_labware import parse_opentrons
from labweb.domain.resources.pose import Pose, compose
from tests.domain.resources.labware_files import Json, a_v3_plate, an_opentrons_plate

TWICE = [{"providesAddressableAreas": {"cutoutA1": ["A1"], "cutoutB1": ["A1"]}}]
FOOTPRINT = {"backLeft": {"x": 0, "y": 0}, "frontRight": {"x": 120, "y": -80}, "z": 0}


def a_slot(*, is_pushed_to_back_left: bool = True) -> Slot:
    footprint = Footprint(
        left_mm=0,
        back_mm=86,
        right_mm=128,
        front_mm=0,
        z_mm=0,
        is_pushed_to_back_left=is_pushed_to_back_left,
    )
    return Slot(name="C2", corner=Vector(164, 107, 0), size=Vector(128, 86, 0), footprint=footprint)


def a_plate(name: str = "plate", **changes: object) -> LabwareDefinition:
    value = an_opentrons_plate(**changes)
    value["parameters"]["loadName"] = name
    return parse_opentrons(value)


def test_labware_of_schema_2_stands_at_the_corner_of_the_slot() -> None:
    """slot ── plate, shifted by its corner offset 1, 2, 3"""
    corner = find_corner([a_plate()], a_slot())
    assert corner == (165, 109, 3)
    where = Pose(*corner)
    well = a_plate().find_well("A1")
    assert well_position(where, well) == (175, 129, 5.5)
    assert well_position(where, well, WellAnchor.TOP, Vector(0, 0, -1)) == (175, 129, 14.5)
    assert well_position(where, well, WellAnchor.CENTER) == (175, 129, 10.5)


def test_labware_of_schema_3_is_pushed_to_the_back_left_of_its_slot() -> None:
    plate = parse_opentrons(a_v3_plate())
    assert find_corner([plate], a_slot()) == (164, 107 + 86 - 80, 0)


def test_labware_of_schema_3_stands_in_the_middle_where_no_spring_pushes() -> None:
    plate = parse_opentrons(a_v3_plate())
    assert find_corner([plate], a_slot(is_pushed_to_back_left=False)) == (168, 110, 0)


def test_only_the_topmost_labware_is_shifted_by_its_corner_offset() -> None:
    """slot ── adapter (14 mm high) ── plate, which goes 4 mm into it"""
    plate = a_plate(stackingOffsetWithLabware={"adapter": {"x": 0.5, "y": 0, "z": 4}})
    assert find_corner([a_plate("adapter"), plate], a_slot()) == (165.5, 109, 13)


def test_the_overlap_is_the_named_one_or_the_default_of_either() -> None:
    on = {"default": {"x": 0, "y": 0, "z": 2}, "adapter": {"x": 0, "y": 0, "z": 5}}
    plate = a_plate(stackingOffsetWithLabware=on)
    assert find_corner([a_plate("adapter"), plate], a_slot()).z_mm == 14 - 5 + 3
    assert find_corner([a_plate("other"), plate], a_slot()).z_mm == 14 - 2 + 3
    generous = an_opentrons_plate(stackingOffsetWithLabware=on)
    generous["parameters"]["quirks"] = ["providesStackingDefault"]
    assert find_corner([parse_opentrons(generous), a_plate()], a_slot()).z_mm == 14 - 2 + 3


def test_labware_that_does_not_say_how_it_stands_on_another_has_no_place() -> None:
    with pytest.raises(InfeasibleError) as refused:
        find_corner([a_plate("below"), a_plate("above")], a_slot())
    assert refused.value.code == "labware.no_seat"
    assert refused.value.context == {"labware": "above", "below": "below"}


def test_a_module_lifts_the_labware_by_its_offset_less_the_overlap() -> None:
    plate = a_plate(stackingOffsetWithModule={"shaker": {"x": 0, "y": 0, "z": 10}})
    shaker = Module(model="shaker", offset=Vector(-0.125, 1.125, 68.275))
    corner = find_corner([plate], a_slot(), shaker)
    assert corner == pytest.approx((164.875, 110.125, 61.275))
    other = Module(model="other", offset=Vector(0, 0, 50))
    assert find_corner([plate], a_slot(), other) == (165, 109, 53)


def test_plates_of_schema_3_meet_by_their_footprints() -> None:
    platform = {"backLeft": {"x": 10, "y": -4}, "frontRight": {"x": 118, "y": -70}, "z": 12}
    features = {"slotFootprintAsChild": FOOTPRINT, "slotFootprintAsParent": platform}
    adapter = parse_opentrons(a_v3_plate("adapter", **features))
    corner = find_corner([adapter, parse_opentrons(a_v3_plate())], a_slot())
    # The adapter stands at 164, 113; the middle of its platform is at 64, 43 of it.
    assert corner == pytest.approx((164 + 64 - 60, 113 + 43 - 40, 12))


def test_a_lid_rests_where_it_touches_the_rack() -> None:
    rack = parse_opentrons(
        a_v3_plate(
            "rack",
            slotFootprintAsChild=FOOTPRINT,
            opentronsFlexTipRackLidAsParent={"matingZ": 84.75},
        )
    )
    lid = a_v3_plate("lid", opentronsFlexTipRackLidAsChild={"matingZ": 2})
    lid["extents"]["total"]["frontRightTop"]["y"] = -70
    corner = find_corner([rack, parse_opentrons(lid)], a_slot())
    # Both have their back left corner at the same place.
    assert corner == pytest.approx((164, 113 + 80 - 70, 82.75))


@pytest.mark.parametrize(("side", "x_mm"), [("left", 164 + 7.5), ("right", 164 + 120 - 7.5 - 120)])
def test_a_plate_on_a_flat_adapter_is_pushed_to_the_wall(side: str, x_mm: float) -> None:
    adapter = a_v3_plate(
        "adapter",
        heaterShakerUniversalFlatAdapter={
            "flatSupportThermalCouplingZ": 4.7,
            "deckLeft": {"wallX": 7.5},
            "deckRight": {"wallX": -7.5},
        },
    )
    adapter["features"]["slotFootprintAsChild"] = FOOTPRINT
    plate = a_v3_plate("plate", flatSupportThermalCouplingAsChild={"wellExteriorBottomZ": 1})
    rectangle = Footprint(left_mm=0, back_mm=80, right_mm=120, front_mm=0, z_mm=0)
    module = Module(
        model="shaker",
        offset=Vector(0, 0, 18),
        footprint=rectangle,
        side="left" if side == "left" else "right",
    )
    stack = [parse_opentrons(adapter), parse_opentrons(plate)]
    assert find_corner(stack, a_slot(), module) == pytest.approx((x_mm, 107, 18 + 3.7))


def test_labware_of_schema_3_without_a_feature_has_no_place_on_a_deck() -> None:
    lid = parse_opentrons(a_v3_plate("lid", opentronsFlexTipRackLidAsChild={"matingZ": 0}))
    for module in (None, Module(model="shaker", offset=Vector(0, 0, 5))):
        with pytest.raises(InfeasibleError) as refused:
            find_corner([lid], a_slot(), module)
        assert refused.value.code == "labware.no_seat"


def test_labware_of_schema_3_stands_in_the_middle_of_a_module_that_tells_its_rectangle() -> None:
    rectangle = Footprint(left_mm=0, back_mm=90, right_mm=130, front_mm=0, z_mm=0)
    module = Module(model="shaker", offset=Vector(1, 2, 18), footprint=rectangle)
    corner = find_corner([parse_opentrons(a_v3_plate())], a_slot(), module)
    assert corner == (164 + 1 + 5, 107 + 2 + 5, 18)


def test_two_of_schema_3_without_a_common_feature_meet_back_left_by_their_overlap() -> None:
    upper = a_v3_plate("upper", slotFootprintAsChild=FOOTPRINT)
    upper["stackingOffsetWithLabware"] = {"lower": {"x": 1, "y": 0, "z": 4}}
    upper["extents"]["total"]["frontRightTop"]["y"] = -70
    lower = parse_opentrons(a_v3_plate("lower", slotFootprintAsChild=FOOTPRINT))
    corner = find_corner([lower, parse_opentrons(upper)], a_slot())
    assert corner == (165, 113 + 80 - 70, 14 - 4)


def test_labware_that_overhangs_does_not_stand_on_labware_of_schema_2() -> None:
    wide = a_v3_plate("wide", slotFootprintAsChild=FOOTPRINT)
    wide["extents"]["total"]["backLeftBottom"]["x"] = -5
    wide["stackingOffsetWithLabware"] = {"default": {"x": 0, "y": 0, "z": 4}}
    with pytest.raises(InfeasibleError) as refused:
        find_corner([a_plate("below"), parse_opentrons(wide)], a_slot())
    assert refused.value.code == "labware.no_seat"


def test_an_empty_stack_has_no_place() -> None:
    with pytest.raises(InfeasibleError):
        find_corner([], a_slot())


def test_turned_labware_has_its_wells_turned_about_its_corner() -> None:
    """A quarter turn to the left: what was to the right is now to the back."""
    half = math.sqrt(0.5)
    quarter = Pose(100, 50, 7, (half, 0, 0, half))
    well = a_plate().find_well("A1")
    assert well_position(quarter, well) == pytest.approx((100 - 20, 50 + 10, 9.5))
    twice = compose(quarter, Pose(10, 0, 0, (half, 0, 0, half)))
    assert (twice.x_mm, twice.y_mm) == pytest.approx((100, 60))
    assert well_position(twice, well) == pytest.approx((100 - 10, 60 - 20, 9.5))


def a_deck(**changes: object) -> Json:
    area = {
        "id": "A1",
        "areaType": "slot",
        "offsetFromCutoutFixture": [1.0, 0.0, 14.5],
        "matingSurfaceUnitVector": [-1, 1, -1],
        "boundingBox": {"xDimension": 128.0, "yDimension": 86.0, "zDimension": 0},
    }
    return {
        "schemaVersion": 5,
        "otId": "deck",
        "metadata": {"displayName": "Deck"},
        "dimensions": [600, 500, 0],
        "cornerOffsetFromOrigin": [-20, -10, 0],
        "locations": {
            "cutouts": [
                {"id": "cutoutA1", "position": [0, 321, 0]},
                {"id": "cutoutB1", "position": [0, 214, 0]},
            ],
            "addressableAreas": [area],
        },
        "cutoutFixtures": [{"providesAddressableAreas": {"cutoutA1": ["A1"]}}],
        **changes,
    }


def test_a_slot_lies_at_its_cutout_plus_its_own_offset() -> None:
    deck = parse_opentrons_deck(a_deck())
    assert deck.find_slot("A1").corner == (1, 321, 14.5)
    assert deck.find_slot("A1").footprint.is_pushed_to_back_left
    with pytest.raises(NotFoundError):
        deck.find_slot("Z9")


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"schemaVersion": 3}, "labware.version"),
        ({"dimensions": [1, 2]}, "labware.field"),
        ({"cutoutFixtures": 5}, "labware.field"),
        (
            {"cutoutFixtures": [{"providesAddressableAreas": {"cutoutA1": ["A7"]}}]},
            "labware.deck",
        ),
        ({"cutoutFixtures": [{"providesAddressableAreas": {"cutoutA1": 3}}]}, "labware.field"),
        ({"locations": {"cutouts": [], "addressableAreas": []}}, "labware.deck"),
        ({"cutoutFixtures": TWICE}, "labware.deck"),
    ],
)
def test_a_deck_that_is_wrong_is_refused(changes: Json, code: str) -> None:
    with pytest.raises(DefinitionError) as refused:
        parse_opentrons_deck(a_deck(**changes))
    assert code in {finding.code for finding in refused.value.findings}
