"""Nodes in the form that PyLabRobot writes count µL, beside nodes of the same graph that count mL.

The rig is the station of `test_advice_on_stations`.
"""

from __future__ import annotations

import json
from typing import Any

import pytest

from labweb.domain.errors import LabError
from labweb.domain.graph.lab_file.uni_lab_os.graph_read import read_uni_lab_os
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.graph.rig.stated_volumes import check_volumes
from labweb.domain.recipes.recipe_preview import PreviewAsked
from tests.domain.recipes.plans import compiled, unproved
from tests.domain.recipes.test_advice_on_labs import ADD, recipe
from tests.domain.recipes.test_advice_on_stations import advised, station

PYLABROBOT = {
    "type": "Container",
    "category": "container",
    "size_x": 9.0,
    "size_y": 9.0,
    "size_z": 40.0,
    "rotation": {"x": 0, "y": 0, "z": 0, "type": "Rotation"},
}


def counting(key: str, size: object, *liquids: list[object]) -> dict[str, Any]:
    """Return the station with one vessel in PyLabRobot's form."""
    graph: dict[str, Any] = json.loads(station())
    node = next(one for one in graph["nodes"] if one["id"] == key)
    node["config"] = {**PYLABROBOT, "max_volume": size}
    node["data"] = {"liquids": list(liquids)}
    return graph


def said(graph: dict[str, Any]) -> list[str]:
    return [one.message for one in check_volumes(read_rig(json.dumps(graph).encode()))]


def test_a_size_in_microlitres_is_the_size_that_compiler_and_verifier_know() -> None:
    graph = counting("main", 2_000)
    plan = compiled(recipe(ADD), graph)
    assert plan["capacities_ul"]["main"] == 2_000
    too_much = compiled(recipe(ADD.replace("2 mL", "3 mL")), counting("main", 3_000))
    too_much["capacities_ul"].pop("main")
    rig = read_rig(json.dumps(graph).encode())
    assert unproved(plan, rig) == []
    assert "interpret.overflow" in {one.code for one in unproved(too_much, rig)}


def test_a_vessel_of_microlitres_overflows_and_is_exchanged_for_one_of_microlitres() -> None:
    graph = counting("main", 360)
    with pytest.raises(LabError) as caught:
        compiled(recipe(ADD), graph)
    assert [one.code for one in caught.value.findings] == ["plan.overflow"]
    advice = advised(PreviewAsked(name="r", recipe=recipe(ADD), graph=json.dumps(graph).encode()))
    (change,) = advice["changes"]
    assert "which holds 0.36 mL, for one of " in change["text"]
    new = next(one for one in json.loads(advice["graph"])["nodes"] if one["id"] == "main")
    larger_ml = int(change["text"].split()[-2])
    assert new["config"] == {**PYLABROBOT, "max_volume": larger_ml * 1000}


def test_contents_in_microlitres_are_contents_in_microlitres() -> None:
    plan = compiled(recipe(ADD), counting("collection", 50_000, ["DMF", 100.5]))
    assert plan["contents"]["collection"] == [{"lot": "DMF", "phase": "liquid", "volume_ul": 100.5}]


def test_the_import_of_the_same_graph_reads_the_same_amounts() -> None:
    graph = counting("main", 2_000, ["DMF", 100.5])
    lab = read_uni_lab_os(json.dumps(graph).encode(), "station")
    main = next(one for one in lab.resources if one.name == "main")
    assert main.config["capacity_ul"] == 2_000
    assert [*lab.contents[main.id].values()] == [100_500]
    plan = compiled(recipe(ADD.replace("2 mL", "1 mL")), graph)
    assert plan["contents"]["main"][0]["volume_ul"] == 100.5


def test_a_vessel_that_pylabrobot_calls_endless_has_no_size() -> None:
    graph = counting("main", "Infinity")
    assert said(graph) == []
    assert "main" not in compiled(recipe(ADD), graph)["capacities_ul"]
    plain: dict[str, Any] = json.loads(station())
    next(one for one in plain["nodes"] if one["id"] == "main")["config"]["max_volume"] = "Infinity"
    assert said(plain) == [
        "`max_volume` of node main is 'Infinity', which is no volume in mL; correct it, or take "
        "the field away where nobody knows"
    ]


@pytest.mark.parametrize(("amount", "is_refused"), [(0.001, False), (0.0005, True), (1e-9, True)])
def test_contents_finer_than_a_nanolitre_are_refused_and_not_cut(
    amount: float, is_refused: bool
) -> None:
    found = said(counting("main", 2_000, ["DMF", amount]))
    assert bool(found) is is_refused
    assert all("finer than a nanolitre" in message for message in found)


def test_a_message_names_the_unit_of_its_node() -> None:
    assert said(counting("main", 2_000, ["", 5])) == [
        "node main lists 5 µL of a liquid without a name"
    ]
    assert said(counting("main", "much")) == [
        "`max_volume` of node main is 'much', which is no volume in µL; correct it, or take the "
        "field away where nobody knows"
    ]


LISTED = [{"liquid_type": "DMF", "liquid_volume": 5}]


def test_a_list_of_liquids_that_stands_in_a_node_twice_is_read_once() -> None:
    graph = counting("collection", 50_000, ["DMF", 5])
    node = next(one for one in graph["nodes"] if one["id"] == "collection")
    node["data"]["liquid"] = LISTED
    assert compiled(recipe(ADD), graph)["contents"]["collection"][0]["volume_ul"] == 5
    lab = read_uni_lab_os(json.dumps(graph).encode(), "station")
    assert 5_000 in [nl for held in lab.contents.values() for nl in held.values()]


def test_two_lists_of_liquids_that_differ_are_refused() -> None:
    graph = counting("collection", 50_000, ["DMF", 6])
    next(one for one in graph["nodes"] if one["id"] == "collection")["data"]["liquid"] = LISTED
    assert said(graph) == [
        "node collection lists its liquids more than once and differs: list them once"
    ]


def test_a_size_that_the_import_cannot_read_is_told() -> None:
    for size, is_told in ((2_000, False), ("Infinity", False), ("2000", True), (0.0001, True)):
        lab = read_uni_lab_os(json.dumps(counting("main", size)).encode(), "station")
        codes = [one.code for one in lab.notes if one.subject == "main"]
        assert codes == ["uni_lab_os.amount_unread"] * is_told


@pytest.mark.parametrize("field", ["config", "data"])
def test_a_node_whose_settings_are_no_object_is_refused(field: str) -> None:
    graph = counting("main", 2_000)
    next(one for one in graph["nodes"] if one["id"] == "main")[field] = "much"
    with pytest.raises(LabError) as caught:
        read_rig(json.dumps(graph).encode())
    assert [(one.code, one.subject) for one in caught.value.findings] == [
        ("lab_file.field", "main")
    ]


def test_a_graph_with_links_and_edges_is_refused() -> None:
    graph = counting("main", 2_000)
    graph["edges"] = [graph["links"].pop()]
    with pytest.raises(LabError) as caught:
        read_rig(json.dumps(graph).encode())
    assert [one.code for one in caught.value.findings] == ["lab_file.links_twice"]


@pytest.mark.parametrize(
    "said_so",
    [
        {"config": None, "max_volume": 1},
        {"config": {}, "max_volume": 1},
        {"config": {}, "data": {"max_volume": 1}},
        {"config": {"capacity_ul": 1000}},
    ],
)
def test_a_vessel_is_exchanged_wherever_its_size_is_said(said_so: dict[str, Any]) -> None:
    graph: dict[str, Any] = json.loads(station())
    next(one for one in graph["nodes"] if one["id"] == "main").update(said_so)
    advice = advised(PreviewAsked(name="r", recipe=recipe(ADD), graph=json.dumps(graph).encode()))
    (change,) = advice["changes"]
    assert "which holds 1 mL, for one of 25 mL" in change["text"]
    new = next(one for one in json.loads(advice["graph"])["nodes"] if one["id"] == "main")
    assert new["config"] == {"max_volume": 25}
    assert "max_volume" not in new
