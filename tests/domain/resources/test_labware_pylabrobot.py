"""Serialised resources of PyLabRobot: every place as its engine has it, or refused."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.errors import DefinitionError
from labweb.domain.resources.labware.labware_definition import Vector
from labweb.domain.resources.labware.labware_parts import (
    LabwarePart,
    definition_of,
    find_bottoms,
    walk,
)
from labweb.domain.resources.labware.pylabrobot import parse_pylabrobot
from labweb.domain.resources.labware.well_geometry import volume_ul
from tests.corpus import LABWARE, NO_LABWARE
from tests.domain.resources.labware_files import PYLABROBOT, Json, load, published

corpus = pytest.mark.skipif(not LABWARE.is_dir(), reason=NO_LABWARE)


def a_node(name: str, category: str | None, *children: Json, **changes: object) -> Json:
    """One serialised resource, 10 mm wide, at 1, 2, 3 of its parent."""
    return {
        "name": name,
        "type": "Resource",
        "category": category,
        "model": None,
        **{"size_x": 10, "size_y": 8, "size_z": 5},
        "location": {"x": 1, "y": 2, "z": 3, "type": "Coordinate"},
        "rotation": {"x": 0, "y": 0, "z": 0, "type": "Rotation"},
        "children": list(children),
        **changes,
    }


def turned(x: float = 0, y: float = 0, z: float = 0) -> Json:
    return {"x": x, "y": y, "z": z, "type": "Rotation"}


def a_plate(name: str = "plate", **changes: object) -> Json:
    wells = [a_node(f"{name}_{a}", "well", max_volume=360.5) for a in ("A1", "B1")]
    ordering = {a: f"{name}_{a}" for a in ("A1", "B1")}
    return a_node(name, "plate", *wells, ordering=ordering, **changes)


def findings_of(value: object) -> dict[str, str]:
    with pytest.raises(DefinitionError) as refused:
        parse_pylabrobot(value)
    assert refused.value.code == "labware.invalid"
    return {finding.subject: finding.code for finding in refused.value.findings}


def bottom(part: LabwarePart, name: str) -> Vector:
    found = find_bottoms(part)[name]
    assert found is not None
    return found


@corpus
@pytest.mark.parametrize("deck", ["ot", "star"])
def test_every_place_of_a_published_deck_is_where_the_engine_has_it(deck: str) -> None:
    part, notes = parse_pylabrobot(load(PYLABROBOT / f"plr_deck_{deck}.json"))
    assert notes == []
    wanted = load(PYLABROBOT / f"plr_abs_locations_{deck}.json")
    ours = find_bottoms(part)
    assert len(wanted) == 288
    for name, place in wanted.items():
        found = ours[name]
        assert found is not None
        assert max(abs(a - b) for a, b in zip(found, place, strict=True)) <= 0.001, name


@corpus
def test_the_plates_and_racks_of_a_published_deck_are_labware() -> None:
    part, _ = parse_pylabrobot(load(PYLABROBOT / "plr_deck_star.json"))
    found = [definition_of(p) for p, _ in walk(part) if p.kind in ("plate", "tip_rack")]
    assert [(labware.kind, labware.well_kind, len(labware.wells)) for labware in found] == [
        ("tip_rack", "tip_spot", 8),
        ("tip_rack", "tip_spot", 96),
        ("plate", "well", 96),
        ("plate", "well", 96),
    ]
    assert found[1].tip is not None
    assert (found[1].tip.length_mm, found[1].tip.capacity_nl) == (59.9, 360_000)
    assert found[2].find_well("H12").capacity_nl == 360_000


@corpus
def test_the_same_plate_measured_and_drawn_holds_nearly_the_same() -> None:
    part, _ = parse_pylabrobot(load(PYLABROBOT / "plr_deck_ot.json"))
    (measured, *_) = [definition_of(p) for p, _ in walk(part) if p.kind == "plate"]
    drawn = published("corning_96_wellplate_360ul_flat").find_well("A1").cavity
    table = measured.find_well("A1").cavity
    assert drawn is not None
    assert table is not None
    for height_mm in (2.0, 4.0, 6.0, 8.0, 10.0):
        assert abs(volume_ul(table, height_mm) - volume_ul(drawn, height_mm)) < 12


def test_a_well_is_placed_through_all_that_it_stands_in() -> None:
    """deck ── carrier ── slot ── plate ── A1, each at 1, 2, 3 of the one before"""
    slot = a_node("slot", "resource_holder", a_plate())
    deck = a_node("deck", "deck", a_node("carrier", "plate_carrier", slot))
    part, _ = parse_pylabrobot(deck)
    assert [p.kind for p, _ in walk(part)] == ["deck", "carrier", "slot", "plate", "well", "well"]
    assert bottom(part, "plate_A1") == (5 + 5, 10 + 4, 15)


def test_a_turned_plate_turns_its_wells_about_its_corner() -> None:
    part, _ = parse_pylabrobot(a_plate(rotation=turned(z=90)))
    # The middle of A1 is at 6, 6, 3 of the plate, whose corner is at 1, 2, 3.
    assert bottom(part, "plate_A1") == pytest.approx((1 - 6, 2 + 6, 6))


def test_turns_about_the_same_axis_add_up() -> None:
    inner = a_node("inner", "plate", rotation=turned(z=270))
    part, _ = parse_pylabrobot(a_node("outer", "carrier", inner, rotation=turned(z=90)))
    assert bottom(part, "inner") == pytest.approx((1 - 2 + 5, 2 + 1 + 4, 6))


def test_one_part_is_turned_about_x_then_y_then_z() -> None:
    part, _ = parse_pylabrobot(a_node("tilted", "plate", rotation=turned(x=90, z=90)))
    # 5, 4, 0 about x is 5, 0, 4, and that about z is 0, 5, 4.
    assert bottom(part, "tilted") == pytest.approx((1, 7, 7))


def test_turns_about_different_axes_in_each_other_are_refused() -> None:
    inner = a_node("inner", "plate", rotation=turned(z=90))
    outer = a_node("outer", "carrier", inner, rotation=turned(x=90))
    assert findings_of(outer) == {"children[0].rotation": "labware.rotation"}


def test_a_part_without_a_place_is_nowhere_and_so_is_all_in_it() -> None:
    part, _ = parse_pylabrobot(a_node("deck", "deck", a_plate(location=None)))
    found = find_bottoms(part)
    assert found["deck"] is not None
    assert found["plate"] is None
    assert found["plate_A1"] is None


def test_a_plate_alone_stands_at_the_origin() -> None:
    part, _ = parse_pylabrobot(a_plate(location=None))
    assert part.pose is None
    assert bottom(part, "plate_A1") == (6, 6, 3)


def test_a_category_that_nobody_mapped_is_foreign() -> None:
    part, _ = parse_pylabrobot(a_node("thing", "core_grippers"))
    assert part.kind == "foreign"
    part, _ = parse_pylabrobot(a_node("thing", None))
    assert part.kind == "foreign"


def test_infinite_room_is_unknown_room() -> None:
    part, _ = parse_pylabrobot(a_node("bin", "trash", max_volume="Infinity"))
    assert (part.kind, part.capacity_nl) == ("waste", None)


def test_code_of_others_is_left_out_and_noted() -> None:
    code = {"type": "function", "code": "evil"}
    part, notes = parse_pylabrobot(a_node("well", "well", compute_volume_from_height=code))
    assert part.cavity is None
    assert [note.code for note in notes] == ["labware.code_left_out"]


def test_a_lid_on_a_plate_is_no_well_of_it() -> None:
    plate = a_plate()
    plate.update(size_x=40, size_y=40, size_z=40)
    plate["children"][1]["location"]["x"] = 20
    plate["children"].append(a_node("lid", "lid"))
    part, _ = parse_pylabrobot(plate)
    assert [well.address for well in definition_of(part).wells] == ["A1", "B1"]


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"ordering": None}, "labware.address"),
        ({"location": None}, "labware.no_place"),
        ({"rotation": turned(z=10)}, "labware.rotation"),
    ],
)
def test_a_plate_whose_wells_are_not_told_is_no_labware(change: Json, code: str) -> None:
    plate = a_plate()
    if "ordering" in change:
        plate |= change
    else:
        plate["children"][0] |= change
    part, _ = parse_pylabrobot(plate)
    with pytest.raises(DefinitionError) as refused:
        definition_of(part)
    assert code in {finding.code for finding in refused.value.findings}


@pytest.mark.parametrize(
    ("changes", "subject", "code"),
    [
        ({"name": ""}, "name", "labware.text"),
        ({"size_x": -1}, "size_x", "labware.number"),
        ({"size_y": math.nan}, "size_y", "labware.number"),
        ({"size_z": "5"}, "size_z", "labware.field"),
        ({"location": [1, 2, 3]}, "location", "labware.field"),
        ({"location": {"x": math.inf, "y": 0, "z": 0}}, "location.x", "labware.number"),
        ({"rotation": {"x": 1e9}}, "rotation.x", "labware.number"),
        ({"children": "many"}, "children", "labware.field"),
        ({"children": [3]}, "children[0]", "labware.field"),
        ({"max_volume": -4}, "max_volume", "labware.number"),
        ({"max_volume": 0.00001}, "max_volume", "labware.amount"),
        ({"height_volume_data": {"a": 1}}, "height_volume_data", "labware.number"),
        (
            {"height_volume_data": {"0": 0, "2": 9, "3": 4}},
            "height_volume_data",
            "labware.geometry",
        ),
        ({"ordering": {"A1": "other"}}, "ordering", "labware.ordering"),
    ],
)
def test_a_wrong_field_is_named(changes: Json, subject: str, code: str) -> None:
    assert findings_of(a_node("well", "well") | changes).get(subject) == code


@pytest.mark.parametrize("value", [None, [], "deck", 7])
def test_what_is_no_object_is_refused(value: object) -> None:
    assert findings_of(value) == {"": "labware.field"}


def test_a_name_stands_once() -> None:
    deck = a_node("deck", "deck", a_node("same", "plate"), a_node("same", "plate"))
    assert findings_of(deck) == {"children[1].name": "labware.duplicate"}


def test_heights_need_not_start_at_the_bottom() -> None:
    well = a_node("well", "well", height_volume_data={"1.5": 20, "3": 80})
    part, _ = parse_pylabrobot(well)
    assert part.cavity is not None
    assert volume_ul(part.cavity, 0.75) == 10


def test_a_table_with_more_points_than_any_well_needs_is_refused() -> None:
    points = {str(n): n for n in range(1001)}
    found = findings_of(a_node("well", "well", height_volume_data=points))
    assert found == {"height_volume_data": "labware.too_many"}


def test_a_tree_that_is_too_deep_is_refused() -> None:
    node = a_node("0", "carrier")
    for depth in range(1, 40):
        node = a_node(str(depth), "carrier", node)
    assert set(findings_of(node).values()) == {"labware.depth"}


@given(st.data())
def test_no_value_in_any_place_is_met_with_anything_but_a_definition_error(
    data: st.DataObject,
) -> None:
    base: Any = json.loads(json.dumps(a_node("deck", "deck", a_plate())))
    place = base
    for _ in range(data.draw(st.integers(0, 4))):
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        key = data.draw(st.sampled_from(keys))
        if not isinstance(place[key], dict | list) or not place[key]:
            break
        place = place[key]
    keys = list(place) if isinstance(place, dict) else list(range(len(place)))
    odd = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4)
    inner = odd | st.lists(odd, max_size=2) | st.dictionaries(st.text(max_size=3), odd)
    place[data.draw(st.sampled_from(keys))] = data.draw(inner)
    try:
        part, _ = parse_pylabrobot(base)
    except DefinitionError:
        return
    for found in find_bottoms(part).values():
        assert found is None or all(math.isfinite(number) for number in found)
