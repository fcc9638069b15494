"""Labware as resources: keys, ids, poses and config of the plate and of each well."""

from __future__ import annotations

from functools import partial
from uuid import UUID, uuid5

import pytest

from labweb.domain.errors import DefinitionError
from labweb.domain.graph.lab_file.resource_config import check_config
from labweb.domain.resources.labware.labware_definition import Vector
from labweb.domain.resources.labware.labware_formats import read_labware, resources_of
from labweb.domain.resources.labware.labware_parts import find_bottoms
from labweb.domain.resources.labware.labware_resources import (
    LabwareIdentity,
    ids_in_labware,
    labware_resources,
    part_resources,
    tip_id,
    well_id,
)
from labweb.domain.resources.labware.opentrons_labware import parse_opentrons
from labweb.domain.resources.labware.pylabrobot import parse_pylabrobot
from labweb.domain.resources.pose import Pose, compose, rotate
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import KINDS
from labweb.domain.resources.resource_tree import Tree, check_tree
from tests.corpus import LABWARE, NO_LABWARE
from tests.domain.resources.labware_files import (
    OPENTRONS,
    PYLABROBOT,
    an_opentrons_plate,
    load,
)

corpus = pytest.mark.skipif(not LABWARE.is_dir(), reason=NO_LABWARE)

BENCH = UUID(int=1)
PLATE = UUID(int=2)


def an_identity(key: str = "plate_1") -> LabwareIdentity:
    return LabwareIdentity(id=PLATE, key=key, name="Plate 1", parent_id=BENCH)


def test_a_plate_becomes_itself_and_its_wells() -> None:
    rows = labware_resources(parse_opentrons(an_opentrons_plate()), an_identity())
    plate, first, second = rows
    assert (plate.id, plate.key, plate.kind, plate.parent_id) == (PLATE, "plate_1", "plate", BENCH)
    assert plate.pose is None
    assert plate.size_mm == (40, 30, 14)
    assert plate.config == {"definition": "two_wells", "definition_format": "opentrons/2"}
    assert (first.key, first.name, first.kind) == ("plate_1/A1", "Plate 1 A1", "well")
    assert (first.parent_id, first.id) == (PLATE, uuid5(PLATE, "A1"))
    assert second.id == well_id(PLATE, "B1")
    assert first.pose == Pose(7, 17, 2.5)
    assert first.size_mm == (6, 6, 10)
    section = {"shape": "conical", "bottom_mm": 0.0, "top_mm": 10.0, "count": 1}
    assert first.config == {
        "capacity_ul": 250.5,
        "depth_mm": 10.0,
        "is_round": True,
        "cavity": [{**section, "bottom_diameter_mm": 4.0, "top_diameter_mm": 6.0}],
    }


def test_the_same_labware_always_gives_the_same_rows() -> None:
    definition = parse_opentrons(an_opentrons_plate())
    assert labware_resources(definition, an_identity()) == labware_resources(
        definition, an_identity()
    )


def a_rack() -> object:
    parameters = {"isTiprack": True, "loadName": "rack", "tipLength": 50, "tipOverlap": 7.5}
    metadata = {"displayName": "Rack", "displayCategory": "tipRack"}
    return an_opentrons_plate(parameters=parameters, metadata=metadata)


def test_a_rack_has_tips_only_when_a_person_says_so() -> None:
    definition = parse_opentrons(a_rack())
    empty = labware_resources(definition, an_identity("rack"))
    assert [row.kind for row in empty] == ["tip_rack", "tip_spot", "tip_spot"]
    spot_config = {"tip_length_mm": 50, "tip_overlap_mm": 7.5, "tip_capacity_ul": 250.5}
    assert empty[1].config == spot_config
    full = labware_resources(definition, an_identity("rack"), has_tips=True)
    assert [row.kind for row in full] == ["tip_rack", "tip_spot", "tip", "tip_spot", "tip"]
    tip = full[2]
    assert (tip.key, tip.id, tip.parent_id) == (
        "rack/A1/tip",
        tip_id(PLATE, "A1"),
        well_id(PLATE, "A1"),
    )
    assert tip.config == {"capacity_ul": 250.5, "length_mm": 50, "overlap_mm": 7.5}


def test_tips_are_not_put_into_a_plate() -> None:
    with pytest.raises(DefinitionError) as refused:
        labware_resources(parse_opentrons(an_opentrons_plate()), an_identity(), has_tips=True)
    assert [finding.code for finding in refused.value.findings] == ["labware.tips"]


def test_a_key_that_leaves_no_room_for_its_wells_is_refused() -> None:
    with pytest.raises(DefinitionError):
        labware_resources(parse_opentrons(an_opentrons_plate()), an_identity("k" * 495))


def test_a_bin_holds_what_its_only_well_does() -> None:
    value = an_opentrons_plate()
    value["metadata"]["displayCategory"] = "trash"
    (row,) = labware_resources(parse_opentrons(value), an_identity("bin"))
    assert (row.kind, row.config) == ("waste", {"capacity_ul": 501})


def test_what_nobody_mapped_is_foreign_and_has_no_wells() -> None:
    value = an_opentrons_plate()
    value["metadata"]["displayCategory"] = "system"
    (row,) = labware_resources(parse_opentrons(value), an_identity("thing"))
    assert (row.kind, row.config) == ("foreign", {})


@pytest.mark.parametrize(("key", "name"), [("", "Plate"), ("p\n", "Plate"), ("p", "\x00")])
def test_a_key_or_name_that_is_none_is_refused(key: str, name: str) -> None:
    identity = LabwareIdentity(id=PLATE, key=key, name=name, parent_id=BENCH)
    with pytest.raises(DefinitionError) as refused:
        labware_resources(parse_opentrons(an_opentrons_plate()), identity)
    assert [finding.code for finding in refused.value.findings] == ["labware.text"]


def configs_are_allowed(rows: tuple[Resource, ...]) -> bool:
    return not [f for row in rows for f in check_config(row.kind, row.config, row.key)]


@corpus
def test_every_published_definition_becomes_a_tree_that_a_lab_file_takes() -> None:
    for path in sorted(OPENTRONS.glob("v[23]/*.json")):
        definition = parse_opentrons(load(path))
        rows = labware_resources(definition, an_identity(), has_tips=definition.tip is not None)
        assert configs_are_allowed(rows), path.name
        root = Resource(
            id=BENCH,
            key="bench",
            name="Bench",
            kind="bench",
            nature=KINDS["bench"].nature,
            parent_id=None,
        )
        assert check_tree([root, *rows]) == []
        vessels = [row for row in rows if row.kind in ("well", "tube", "trough")]
        wanted = [] if definition.well_kind in (None, "tip_spot") else definition.wells
        assert len(vessels) == len(wanted)
        for row, well in zip(vessels, wanted, strict=True):
            assert round(row.config["capacity_ul"] * 1000) == well.capacity_nl


@corpus
@pytest.mark.parametrize("deck", ["ot", "star"])
def test_a_published_deck_becomes_rows_that_stand_where_the_engine_has_them(deck: str) -> None:
    part, _ = parse_pylabrobot(load(PYLABROBOT / f"plr_deck_{deck}.json"))
    identity = LabwareIdentity(id=PLATE, key="deck", name="Deck", parent_id=None)
    rows = part_resources(part, identity, partial(uuid5, PLATE), full_racks={"tips"})
    assert check_tree(rows) == []
    assert configs_are_allowed(rows)
    tree = Tree(rows)
    wanted = load(PYLABROBOT / f"plr_abs_locations_{deck}.json")
    found = find_bottoms(part)
    assert set(wanted) <= set(found)
    seen = 0
    for row in rows:
        if row.kind not in ("well", "tip_spot") or "teaching" in row.key:
            continue
        labware, address = row.key.split("/")[-2:]
        sort = "tipspot" if row.kind == "tip_spot" else "well"
        place = wanted[f"{labware}_{sort}_{address}"]
        assert bottom_of(tree, row) == pytest.approx(place, abs=0.001), row.key
        seen += 1
    assert seen == 288
    tips = [row for row in rows if row.kind == "tip"]
    assert len(tips) == 96
    assert {row.config["capacity_ul"] for row in tips} == {360}


@corpus
def test_the_slots_of_one_deck_are_the_same_by_both_engines() -> None:
    deck = read_labware(load(OPENTRONS / "deck/v5_ot2_standard.json"))
    other = read_labware(load(PYLABROBOT / "plr_deck_ot.json"))
    assert (deck.format, other.format) == ("opentrons-deck/5", "pylabrobot")
    one, two = (
        Tree(resources_of(file, an_identity("deck"), partial(uuid5, PLATE)))
        for file in (deck, other)
    )
    assert configs_are_allowed(one.resources)
    assert len(one.resources) == 13
    for n in range(1, 13):
        ours, theirs = one.by_key[f"deck/{n}"].pose, two.by_key[f"deck/ot2_deck_slot_{n}"].pose
        assert ours is not None
        assert theirs is not None
        assert (ours.x_mm, ours.y_mm) == pytest.approx((theirs.x_mm, theirs.y_mm), abs=0.001)


@corpus
def test_a_person_may_say_that_every_rack_of_a_file_is_full() -> None:
    file = read_labware(load(PYLABROBOT / "plr_deck_star.json"))
    rows = resources_of(file, an_identity("deck"), partial(uuid5, PLATE), is_full=True)
    assert sum(row.kind == "tip" for row in rows) == 96 + 8
    deck = read_labware(load(OPENTRONS / "deck/v5_ot3_standard.json"))
    with pytest.raises(DefinitionError):
        resources_of(deck, an_identity("deck"), partial(uuid5, PLATE), is_full=True)


@pytest.mark.parametrize("value", [None, [], {}, {"schemaVersion": 2}, {"type": "Plate"}])
def test_a_file_of_another_format_is_refused(value: object) -> None:
    with pytest.raises(DefinitionError) as refused:
        read_labware(value)
    assert refused.value.code == "labware.unknown_format"


def bottom_of(tree: Tree, row: Resource) -> Vector:
    """Find the middle of the bottom of a resource from the rows alone."""
    pose = row.pose
    assert pose is not None
    assert row.size_mm is not None
    for parent in tree.ancestors(row.id):
        assert parent.pose is not None
        pose = compose(parent.pose, pose)
    middle = rotate(pose.rotation_wxyz, (row.size_mm[0] / 2, row.size_mm[1] / 2, 0.0))
    return Vector(pose.x_mm, pose.y_mm, pose.z_mm).plus(Vector(*middle))


def test_ids_in_labware_come_from_the_labware_wherever_its_key_leads() -> None:
    """room ── deck/rack ── A1 ── tip, and a flask whose key only looks like a well's"""
    kinds = {"deck/rack": "tip_rack", "deck/rack/A1": "tip_spot", "deck/rack/A1/tip": "tip"}
    kinds |= {"room": "room", "room/flask": "flask", "room/A1": "well"}
    ids = {key: uuid5(BENCH, key) for key in kinds}
    assert ids_in_labware(kinds, ids) == {
        "deck/rack/A1": well_id(ids["deck/rack"], "A1"),
        "deck/rack/A1/tip": tip_id(ids["deck/rack"], "A1"),
    }
