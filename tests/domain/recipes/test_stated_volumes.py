"""What a graph says of volumes is read, or refused with the node and the field that say it.

The rig is the bench of `test_recipe_plan`.
"""

from __future__ import annotations

import json
from typing import Any

import pytest

from labweb.domain.errors import LabError
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.graph.rig.stated_volumes import check_volumes
from tests.domain.recipes.plans import bench, claims, compiled, reasons, recipe, unproved

ADD = 'Add vessel="reactor" reagent="water" volume="60 mL"'


def stating(key: str, **said: object) -> dict[str, Any]:
    graph = bench()
    next(node for node in graph["nodes"] if node["id"] == key).update(said)
    return graph


def found(graph: dict[str, Any]) -> list[tuple[str, str]]:
    listed = check_volumes(read_rig(json.dumps(graph).encode()))
    assert all(one.code == "graph.bad_volume" for one in listed)
    return [(one.subject, str(one.context["field"])) for one in listed]


@pytest.mark.parametrize(
    "said",
    [
        *("much", "500 mL", -500, 0, "0.0", True, [500], 1e300, "nan"),
        *("1_000", "\u0661\u0660\u0660", "\uff15\uff10\uff10", "5e2", "500,0", "0x1F4", "5 00"),
    ],
)
def test_a_size_that_is_none_is_refused_and_never_endless(said: object) -> None:
    graph = stating("reactor", max_volume=said)
    with pytest.raises(LabError) as caught:
        compiled(recipe(ADD), graph)
    (finding,) = caught.value.findings
    assert (finding.code, finding.subject) == ("graph.bad_volume", "reactor")
    assert "`max_volume`" in finding.message
    assert repr(said) in finding.message


@pytest.mark.parametrize("said", ["much", -1, "-0.5", False, {"mL": 5}, 1e300])
def test_a_level_that_is_none_is_refused_and_never_empty(said: object) -> None:
    graph = stating("separator", current_volume=said)
    assert reasons(recipe(ADD), graph) == ["graph.bad_volume"]
    assert found(graph) == [("separator", "current_volume")]


@pytest.mark.parametrize("said", ["500", " 500.0 ", "+500", "500.", 500, 500.0])
def test_a_size_in_digits_is_read_as_number_and_as_text(said: object) -> None:
    assert compiled(recipe(ADD), stating("reactor", max_volume=said))["capacities_ul"][
        "reactor"
    ] == pytest.approx(500_000)


def test_a_limit_with_strokes_between_its_digits_is_refused() -> None:
    graph = stating("heater", max_temp="1_00")
    assert reasons(recipe(ADD), graph) == ["graph.bad_value"]


@pytest.mark.parametrize("said", [None, ""])
def test_a_vessel_that_says_nothing_of_its_size_and_level_is_as_before(said: object) -> None:
    graph = stating("reactor", max_volume=said, current_volume=said)
    plan = compiled(recipe(ADD), graph)
    assert "reactor" not in plan["capacities_ul"]
    assert claims(plan, "transfer")[0]["volume_ul"] == 60000.0


def test_a_level_of_nothing_is_a_level() -> None:
    assert found(stating("reactor", current_volume=0)) == []


def test_the_collecting_flask_of_an_evaporator_is_looked_at() -> None:
    graph = bench()
    graph["nodes"].append({"id": "r", "class": "IKARV10", "collection_flask_volume": "large"})
    assert found(graph) == [("r", "collection_flask_volume")]


def test_the_syringe_of_a_pump_is_looked_at() -> None:
    assert found(stating("pump_1", max_volume="25 or so")) == [("pump_1", "max_volume")]


def test_what_a_tube_holds_is_looked_at() -> None:
    graph = bench()
    graph["links"][0]["volume"] = "short"
    key = read_rig(json.dumps(graph).encode()).tubes[0].key
    assert found(graph) == [(key, "volume")]


def test_a_volume_that_is_said_twice_and_differs_is_refused() -> None:
    graph = stating("reactor", max_volume=500, config={"max_volume": 100})
    assert found(graph) == [("reactor", "max_volume")]
    assert found(stating("reactor", max_volume=500, config={"max_volume": "500.0"})) == []


@pytest.mark.parametrize(
    "entry",
    [["ether", "much"], ["ether", -3], ["", 5], {"liquid_volume": 5}, {"liquid_type": "ether"}],
)
def test_a_liquid_in_a_list_without_a_volume_or_a_name_is_refused(entry: object) -> None:
    graph = stating("reactor", data={"liquid": [entry]})
    assert found(graph) == [("reactor", "liquid")]
    assert reasons(recipe(ADD), graph) == ["graph.bad_volume"]


def test_a_liquid_in_a_list_is_in_its_vessel_however_it_is_written() -> None:
    entries = (
        ["ether", 5],
        {"liquid_type": "ether", "liquid_volume": 5},
        {"name": "ether", "volume": 5},
    )
    for entry in entries:
        plan = compiled(recipe(ADD), stating("separator", data={"liquids": [entry]}))
        assert plan["contents"]["separator"][0]["volume_ul"] == 5000.0


@pytest.mark.parametrize(
    "said",
    [
        {"config": {"current_volume": 5, "chemical": "ether"}},
        {"data": {"current_volume": 5}, "chemical": "ether"},
        {"data": {"liquid_type": "ether", "liquid_volume": 5}},
        {"data": {"liquid": {"liquid_type": "ether", "liquid_volume": 5}}},
        {"current_volume": 5, "data": {"liquid": [["ether", 5.0]]}},
    ],
)
def test_what_is_in_a_vessel_is_in_it_wherever_its_node_says_so(said: dict[str, object]) -> None:
    contents = compiled(recipe(ADD), stating("separator", **said))["contents"]["separator"]
    assert contents == [{"lot": "ether", "phase": "liquid", "volume_ul": 5000.0}]


@pytest.mark.parametrize("listed", ["water", 5, [["water", 5]]])
def test_a_list_of_liquids_that_is_none_or_differs_from_the_level_is_refused(
    listed: object,
) -> None:
    graph = stating("separator", current_volume=7, data={"liquid": listed})
    assert {subject for subject, _ in found(graph)} == {"separator"}
    assert reasons(recipe(ADD), graph) == ["graph.bad_volume"]


def test_a_syringe_that_is_said_to_hold_something_is_refused() -> None:
    assert reasons(recipe(ADD), stating("pump_1", current_volume=5)) == ["plan.syringe_not_empty"]
    assert claims(compiled(recipe(ADD), stating("pump_1", current_volume=0)), "transfer")


def test_the_verifier_proves_nothing_on_such_a_graph() -> None:
    plan = compiled(recipe(ADD), bench())
    rig = read_rig(json.dumps(stating("reactor", max_volume="much")).encode())
    assert [one.code for one in unproved(plan, rig)] == ["graph.bad_volume"]
