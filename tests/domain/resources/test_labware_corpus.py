"""Published labware, decks and protocols: every well where the engine of Opentrons has it."""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.resources.labware.labware_definition import LabwareDefinition, Vector
from labweb.domain.resources.labware.labware_pose import find_corner, well_position
from labweb.domain.resources.labware.opentrons_deck import parse_opentrons_deck
from labweb.domain.resources.labware.opentrons_labware import parse_opentrons
from labweb.domain.resources.labware.well_geometry import capacity_ul, level_mm, volume_ul
from labweb.domain.resources.pose import Pose
from tests.corpus import LABWARE, NO_LABWARE
from tests.domain.resources.labware_files import OPENTRONS, load, published
from tests.domain.resources.opentrons_protocol import (
    ANALYSES,
    AT_WELLS,
    Bench,
    deck_of,
    module_offsets,
    pairs,
)

pytestmark = pytest.mark.skipif(not LABWARE.is_dir(), reason=NO_LABWARE)

TOLERANCE_MM = 0.001

UNMEASURED = {
    # Files of schema 3 and 4 run in an older engine, whose analysis gives zeros for every place.
    "OT2_S_v3_P300SGen1_None_Gen1PipetteSimple",
    "OT2_S_v4_P300S_None_MM_TM_TM_MOAMTemps",
}
SMALLER_INSIDE = {
    # Their drawn insides hold a little less than the volume that is printed on them.
    "biorad_384_wellplate_50ul": 49.849,
    "corning_12_wellplate_6.9ml_flat": 6866.574,
}


def vector(place: dict[str, float]) -> Vector:
    return Vector(place["x"], place["y"], place["z"])


def is_near(one: Vector, other: Vector) -> bool:
    return max(abs(a - b) for a, b in zip(one, other, strict=True)) <= TOLERANCE_MM


def name_of(path: Path) -> str:
    return path.name.removesuffix(".analysis.json.gz")


@cache
def definitions() -> dict[str, LabwareDefinition]:
    paths = sorted(OPENTRONS.glob("v[23]/*.json"))
    return {path.stem: parse_opentrons(load(path)) for path in paths}


def test_every_published_definition_is_read() -> None:
    found = definitions()
    assert Counter(labware.source for labware in found.values()) == {
        "opentrons/2": 32,
        "opentrons/3": 5,
    }
    assert Counter(labware.kind for labware in found.values()) == {
        "plate": 14,
        "tip_rack": 9,
        "tube_rack": 6,
        "reservoir": 4,
        "waste": 1,
        "carrier": 2,
        "lid": 1,
    }


def test_every_definition_within_a_published_protocol_is_read() -> None:
    paths = [*OPENTRONS.glob("protocol_json/*.json"), *OPENTRONS.glob("analysis/*.protocol.json")]
    count = 0
    for path in paths:
        for value in load(path)["labwareDefinitions"].values():
            parse_opentrons(value)
            count += 1
    assert count == 111


def test_every_well_of_a_definition_is_where_the_file_says() -> None:
    count = 0
    for name, labware in definitions().items():
        (path,) = OPENTRONS.glob(f"v[23]/{name}.json")
        value = load(path)
        back = 0.0
        if value["schemaVersion"] == 3:
            back = -value["extents"]["total"]["frontRightTop"]["y"]
        for address, well in value["wells"].items():
            ours = labware.find_well(address)
            assert is_near(ours.bottom, Vector(well["x"], well["y"] + back, well["z"])), name
            assert ours.capacity_nl == round(well["totalLiquidVolume"] * 1000)
            assert 0 <= ours.bottom.x_mm <= labware.size.x_mm
            assert 0 <= ours.bottom.y_mm <= labware.size.y_mm
            count += 1
    assert count == 3057


def test_every_deck_is_read_and_its_slots_lie_in_rows() -> None:
    for path in sorted((OPENTRONS / "deck").glob("*.json")):
        deck = parse_opentrons_deck(load(path))
        if "ot2" in path.name:
            assert deck.find_slot("1").corner == (0, 0, 0)
            assert deck.find_slot("11").corner == (132.5, 271.5, 0)
        else:
            assert deck.find_slot("D1").corner == (0, 0, 0)
            assert deck.find_slot("A4").corner == (492, 321, 14.5)


@pytest.mark.parametrize("path", ANALYSES, ids=name_of)
def test_every_well_that_an_analysis_visits_is_where_we_have_it(path: Path) -> None:
    analysis = load(path)
    protocol = load(path.with_name(f"{name_of(path)}.protocol.json"))
    if name_of(path) in UNMEASURED:
        places = [c["result"]["position"] for c in analysis["commands"] if at_a_well(c)]
        assert places
        assert {vector(place) for place in places} == {Vector(0, 0, 0)}
        return
    bench = Bench(protocol, deck_of(analysis["robotType"]), module_offsets(analysis))
    visited = 0
    for command, answer in pairs(protocol, analysis):
        bench.follow(command)
        if at_a_well(answer):
            ours = bench.target(command["params"])
            assert is_near(ours, vector(answer["result"]["position"])), (command, ours)
            visited += 1
        elif command["commandType"] == "moveToAddressableArea":
            area = bench.deck.find_slot(command["params"]["addressableAreaName"])
            middle = Vector(area.size.x_mm / 2, area.size.y_mm / 2, area.size.z_mm)
            assert is_near(area.corner.plus(middle), vector(answer["result"]["position"]))
    assert visited == sum(at_a_well(command) for command in analysis["commands"])


def at_a_well(answer: dict[str, Any]) -> bool:
    return answer["commandType"] in AT_WELLS and "position" in (answer.get("result") or {})


def test_every_published_place_is_where_we_have_it() -> None:
    """The list names labware and slot; what it does not name comes from the protocol."""
    rows = load(OPENTRONS / "geometry_vectors.json")
    seen = 0
    for path in ANALYSES:
        mine = [row for row in rows if row["protocol"] == name_of(path)]
        if not mine:
            continue
        analysis = load(path)
        protocol = load(path.with_name(f"{name_of(path)}.protocol.json"))
        bench = Bench(protocol, deck_of(analysis["robotType"]), module_offsets(analysis))
        wanted = iter(mine)
        row = next(wanted, None)
        for command, answer in pairs(protocol, analysis):
            bench.follow(command)
            if row is None or not at_a_well(answer) or not is_row(row, command, answer):
                continue
            assert is_near(bench.target(command["params"]), vector(row["position_mm"])), row
            seen += 1
            row = next(wanted, None)
        assert row is None
    assert seen == len(rows) == 51


def is_row(row: dict[str, Any], command: dict[str, Any], answer: dict[str, Any]) -> bool:
    told = command["params"]
    return (row["command"], row["well"]) == (command["commandType"], told["wellName"]) and row[
        "position_mm"
    ] == answer["result"]["position"]


def test_labware_of_schema_3_is_held_to_the_back_left_of_a_flex_slot() -> None:
    deck = deck_of("OT-3 Standard")
    plate = published("schema3test_96_wellplate_360ul_flat")
    corner = find_corner([plate], deck.find_slot("C2"))
    # Slot at 164, 107, 86 deep; A1 is 11.23 in front of the back of the plate.
    assert is_near(
        well_position(Pose(*corner), plate.find_well("A1")),
        Vector(164 + 14.37, 107 + 86 - 11.23, 3.552),
    )


def test_what_a_well_is_said_to_hold_goes_into_its_drawn_inside() -> None:
    smaller = {}
    for labware in definitions().values():
        for well in labware.wells:
            if well.cavity is not None and well.capacity_nl is not None:
                inside = capacity_ul(well.cavity)
                if inside * 1000 < well.capacity_nl:
                    smaller[labware.name] = round(inside, 3)
    assert smaller == SMALLER_INSIDE


ENGINE = [
    # Labware, well, height in mm, volume in µL.
    ("agilent_1_reservoir_290ml", "A1", 1.177, 3413.8988),
    ("appliedbiosystemsmicroamp_384_wellplate_40ul", "A1", 9.09, 49.8652),
    ("axygen_1_reservoir_90ml", "A1", 9.563, 71524.548),
    ("biorad_96_wellplate_200ul_pcr", "H1", 7.285, 71.3351),
    ("corning_24_wellplate_3.4ml_flat", "D1", 3.654, 706.2825),
    ("corning_6_wellplate_16.8ml_flat", "B1", 0.522, 496.7143),
    ("nest_1_reservoir_195ml", "A1", 20.675, 148118.6129),
    ("nest_96_wellplate_200ul_flat", "A1", 5.4, 176.6041),
    ("opentrons_10_tuberack_falcon_4x50ml_6x15ml_conical", "A1", 24.822, 1911.5387),
    ("opentrons_15_tuberack_falcon_15ml_conical", "C1", 3.546, 52.3462),
    ("opentrons_24_tuberack_eppendorf_1.5ml_safelock_snapcap", "D1", 37.8, 1806.4735),
    ("opentrons_6_tuberack_falcon_50ml_conical", "B1", 86.894, 44093.7142),
    ("schema3test_96_wellplate_360ul_flat", "H1", 5.334, 175.7706),
]
"""What `find_volume_inner_well_geometry` of opentrons 10.1.0 gives for these definitions."""


@pytest.mark.parametrize(("name", "address", "height_mm", "volume"), ENGINE)
def test_volumes_and_heights_are_those_of_the_engine(
    name: str, address: str, height_mm: float, volume: float
) -> None:
    cavity = published(name).find_well(address).cavity
    assert cavity is not None
    assert volume_ul(cavity, height_mm) == pytest.approx(volume, abs=1e-4)
    assert level_mm(cavity, int(volume * 1000)) == pytest.approx(height_mm, abs=TOLERANCE_MM)
