"""Lab files in which something stands, lies or holds what it cannot."""

from __future__ import annotations

import json
from typing import Any

import pytest

from labweb.domain.enrollment.driver_spec import DriverSpec, ParameterSpec, check_config
from labweb.domain.errors import LabFileError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.uni_lab_os.graph_read import read_uni_lab_os

HERE = {"x_mm": 0.0, "y_mm": 0.0, "z_mm": 0.0}


def an_entry(key: str, kind: str, parent: str | None, **fields: Any) -> dict[str, Any]:  # noqa: ANN401
    return {"key": key, "name": key, "kind": kind, "parent": parent, **fields}


def read(*entries: dict[str, Any]) -> None:
    resources = [an_entry("lab", "lab", None), *entries]
    lab = {"schema": "labweb.lab/1", "name": "L", "time_zone": "UTC", "mode": "sim"}
    read_lab(json.dumps({**lab, "resources": resources}).encode())


def found(*entries: dict[str, Any]) -> list[tuple[str, str]]:
    with pytest.raises(LabFileError) as refusal:
        read(*entries)
    return [(finding.code, finding.subject) for finding in refusal.value.findings]


def test_three_plates_in_one_slot_are_refused_each_by_its_node() -> None:
    deck, slot = an_entry("d", "deck", "lab"), an_entry("s", "slot", "d")
    plates = [an_entry(f"p{n}", "plate", "s") for n in (1, 2, 3)]
    read(deck, slot, plates[0])
    assert found(deck, slot, *plates) == [("place.occupied", "p2"), ("place.occupied", "p3")]


@pytest.mark.parametrize(
    ("place", "thing", "code"),
    [
        ("plate", "plate", "place.wrong_kind"),
        ("deck", "plate", "place.wrong_kind"),
        ("bench", "well", "place.wrong_kind"),
        ("flask", "vial", "crutd.no_place"),
    ],
)
def test_what_stands_where_it_cannot_is_refused_by_node(place: str, thing: str, code: str) -> None:
    assert found(an_entry("a", place, "lab"), an_entry("b", thing, "a")) == [(code, "b")]


def test_a_foreign_graph_with_two_plates_in_a_slot_is_read_and_says_so_by_node() -> None:
    def node(key: str, sort: str, parent: str | None) -> dict[str, Any]:
        return {"id": key, "name": key, "type": sort, "parent": parent, "class": "", "children": []}

    nodes = [node("deck", "deck", None), node("p1", "plate", "deck"), node("p2", "plate", "p1")]
    lab = read_uni_lab_os(json.dumps({"nodes": nodes, "links": []}).encode(), "foreign")
    told = {note.subject: note.code for note in lab.notes if note.code.startswith("place.")}
    assert told == {"p1": "place.wrong_kind", "p2": "place.wrong_kind"}


def test_a_slot_off_its_deck_is_refused_and_one_on_its_edge_is_not() -> None:
    deck = an_entry("d", "deck", "lab", size_mm=[600, 400, 10])
    slot = an_entry("s", "slot", "d", size_mm=[128, 86, 0], pose={**HERE, "x_mm": 472})
    read(deck, slot)
    assert found(deck, slot | {"pose": {**HERE, "x_mm": 480}}) == [("pose.outside", "s")]
    assert found(deck, slot | {"pose": {**HERE, "y_mm": -50}}) == [("pose.outside", "s")]


@pytest.mark.parametrize("value", [1e300, -1e9])
def test_a_pose_beyond_all_labs_is_refused(value: float) -> None:
    (finding,) = found(an_entry("b", "bench", "lab", pose={**HERE, "x_mm": value}))
    assert finding == ("pose.too_far", "b")


@pytest.mark.parametrize("size", [[-1, 1, 1], [1e300, 1, 1]])
def test_a_size_that_is_none_is_refused(size: list[float]) -> None:
    ((code, _),) = found(an_entry("b", "bench", "lab", size_mm=size))
    assert code == "lab_file.field"


def test_a_vessel_that_would_hold_more_than_its_box_is_refused() -> None:
    vial = an_entry("v", "vial", "lab", size_mm=[10, 10, 10])
    read(vial | {"config": {"capacity_ul": 1040}})
    assert found(vial | {"config": {"capacity_ul": 1100}}) == [("lab_file.volume", "v")]


@pytest.mark.parametrize(
    ("kind", "config"),
    [
        ("vial", {"dead_volume_ul": 100, "capacity_ul": 100}),
        ("heater", {"min_temperature_c": 60, "max_temperature_c": 50}),
        ("shaker", {"min_speed_rpm": 600, "max_speed_rpm": 500}),
        ("balance", {"resolution_mg": 100, "max_load_mg": 100}),
        ("tip", {"overlap_mm": 60, "length_mm": 50}),
    ],
)
def test_limits_that_cross_are_refused(kind: str, config: dict[str, float]) -> None:
    entry = an_entry("x", kind, "spot" if kind == "tip" else "lab", config=config)
    around = [an_entry("r", "tip_rack", "lab"), an_entry("spot", "tip_spot", "r")]
    assert [code for code, _ in found(*around, entry)] == ["lab_file.range"]


def test_settings_of_a_device_whose_limits_cross_are_refused() -> None:
    number: dict[str, Any] = {"type": "number", "required": False}
    spec = DriverSpec(
        class_name="Heater",
        module="m",
        digest="",
        config=(
            ParameterSpec(name="min_temperature_c", default=20.0, **number),
            ParameterSpec(name="max_temperature_c", default=150.0, **number),
        ),
    )
    assert check_config(spec, {"max_temperature_c": 100.0}) == []
    (finding,) = check_config(spec, {"max_temperature_c": 10.0})
    assert finding.code == "driver.argument_range"
