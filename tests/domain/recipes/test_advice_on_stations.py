"""What to change in a graph of Uni-Lab-OS: a station of two valves, each with a pump.

    water, thf ──▶ valve_1 ◀──▶ valve_2 ──▶ collection, waste
                      └──▶ reactor ◀──┘      nitrogen stands beside, joined to nothing of these

The corrected graph is one of the same format, and on it the recipe is compiled and proved.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from labweb.domain.graph.lab_file.uni_lab_os.graph_read import read_uni_lab_os
from labweb.domain.graph.rig.rig_model import RigFormat
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.graph.rig.rig_write import write_rig
from labweb.domain.recipes.recipe_preview import PreviewAsked, advise_on, open_recipe
from tests.corpus import GRAPHS, NO_GRAPHS
from tests.domain.recipes.test_advice_on_labs import (
    ADD,
    BOIL,
    CHILL,
    FLASK,
    OVER,
    PURGE,
    REFILL,
    ROTAVAP,
    SEPARATE,
    SEPARATOR,
    THROUGH,
    kinds,
    recipe,
)

Node = dict[str, Any]


def vessel(key: str, type_: str = "container", **liquids: float) -> Node:
    held = [[name, volume] for name, volume in liquids.items()]
    return node(key, "container", type_, {"max_volume": 500.0}, {"liquids": held})


def node(key: str, class_: str, type_: str, config: Node, data: Node) -> Node:
    return {
        "id": key,
        "name": key,
        "parent": "station",
        "children": [],
        "type": type_,
        "class": class_,
        "position": {"x": 0, "y": 0, "z": 0},
        "config": config,
        "data": data,
    }


def tube(source: str, source_port: str, target: str, target_port: str) -> Node:
    return {
        "id": f"link_{source}_{source_port}_{target}",
        "source": source,
        "target": target,
        "type": "fluid",
        "port": {source: source_port, target: target_port},
    }


def station(*, positions: int = 8) -> bytes:
    valves = [
        node(f"valve_{n}", "virtual_multiway_valve", "device", {"positions": positions}, {})
        for n in (1, 2)
    ]
    pumps = [
        node(f"pump_{n}", "virtual_transfer_pump", "device", {"max_volume": 25.0}, {})
        for n in (1, 2)
    ]
    vessels = [
        vessel("water", Water=500.0),
        vessel("thf", THF=500.0),
        vessel("main", "reactor"),
        vessel("collection"),
        vessel("drain", "waste"),
    ]
    gas = node("nitrogen", "virtual_gas_source", "device", {}, {"gas_type": "nitrogen"})
    nodes = [*valves, *pumps, *vessels, gas]
    root = node("station", "workstation", "device", {}, {}) | {
        "parent": None,
        "children": [one["id"] for one in nodes],
    }
    links = [
        *(tube(f"pump_{n}", "transferpump", f"valve_{n}", "transferpump") for n in (1, 2)),
        tube("valve_1", "1", "water", "top"),
        tube("valve_1", "2", "thf", "top"),
        tube("valve_1", "3", "main", "top"),
        tube("valve_1", "4", "valve_2", "1"),
        tube("valve_2", "2", "collection", "top"),
        tube("valve_2", "3", "drain", "top"),
    ]
    return json.dumps({"nodes": [root, *nodes], "links": links}).encode()


def advised(asked: PreviewAsked) -> dict[str, Any]:
    """Return the advice, once the corrected graph is read and the recipe is proved on it."""
    assert open_recipe(asked)["plan"] is None
    advice = advise_on(asked)
    assert advice["ok"], advice
    graph = advice["graph"].encode()
    assert read_rig(graph).format is RigFormat.NODE_LINK
    read_uni_lab_os(graph, "station")
    answer = open_recipe(replace(asked, graph=graph))
    assert (answer["findings"], answer["is_proved"]) == ([], True)
    return advice


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (recipe(ADD, ADD.replace("Water", "ether")), ["add_flask"]),
        (recipe(ADD.replace("2 mL", "800 mL"), ADD), ["enlarge"]),
        (recipe(ADD, CHILL), ["attach", "attach"]),
        (recipe(ADD, '<Stir vessel="reactor" time="1 min"/>'), ["attach"]),
        (
            recipe(ADD, SEPARATE, hardware=SEPARATOR),
            ["add_flask", "add_flask", "add_vessel", "attach"],
        ),
        (recipe(ADD, OVER, BOIL, hardware=ROTAVAP), ["add_vessel", "join_vacuum"]),
        (recipe(ADD, PURGE), ["add_valve", "join_gas"]),
        (recipe(REFILL, ADD), ["add_valve", "join_gas", "join_vacuum"]),
    ],
)
def test_what_is_missing_in_a_station_is_drawn_into_it(text: bytes, wanted: list[str]) -> None:
    advice = advised(PreviewAsked(name="r", recipe=text, graph=station()))
    assert sorted(kinds(advice)) == wanted


def test_a_cartridge_and_the_tube_behind_it_are_drawn() -> None:
    text = recipe(ADD, THROUGH, hardware=FLASK)
    text = text.replace(b"<Reagents>", b'<Reagents><Reagent name="silica"/>')
    asked = PreviewAsked(name="r", recipe=text, graph=station(), bind={"flask": "collection"})
    advice = advised(asked)
    assert kinds(advice) == ["add_cartridge"]
    (column,) = (n for n in json.loads(advice["graph"])["nodes"] if "column" in n["class"])
    assert column["config"]["column_type"] == "silica"
    assert column["parent"] == "station"


def test_an_inert_gas_that_is_there_is_led_and_another_is_brought() -> None:
    any_gas = advised(PreviewAsked(name="r", recipe=recipe(ADD, PURGE), graph=station()))
    assert "Lead nitrogen from nitrogen" in any_gas["changes"][1]["text"]
    argon = advised(PreviewAsked(name="r", recipe=recipe(REFILL, ADD), graph=station()))
    assert any("Lead argon from flask_argon" in one["text"] for one in argon["changes"])


def test_a_valve_without_a_free_position_gets_another_beside_it() -> None:
    text = recipe(ADD, ADD.replace("Water", "ether"))
    advice = advised(PreviewAsked(name="r", recipe=text, graph=station(positions=4)))
    assert "add_flask" in kinds(advice)
    full = json.loads(station(positions=4))
    full["links"].append(tube("valve_2", "4", "main", "top"))
    advice = advised(PreviewAsked(name="r", recipe=text, graph=json.dumps(full).encode()))
    assert kinds(advice) == ["add_valve", "add_flask"]


RINSED = '<ResetHandling solvent="Water" volume="5 mL"/>'
DECLARED = json.dumps({"schema": "labweb.declared/1", "groups": {"Water": ["water"]}}).encode()


def divided(*, groups: list[str] | None = None) -> bytes:
    """Let the waste take what is organic alone, and the flask say what is in it."""
    graph = json.loads(station())
    by_id = {one["id"]: one for one in graph["nodes"]}
    by_id["drain"]["config"]["takes"] = ["organic"]
    if groups is not None:
        by_id["water"]["config"]["groups"] = groups
    return json.dumps(graph).encode()


@pytest.mark.parametrize(
    ("graph", "declared"), [(divided(), DECLARED), (divided(groups=["water"]), b"")]
)
def test_a_waste_is_drawn_that_takes_the_streams_of_the_groups(
    graph: bytes, declared: bytes
) -> None:
    advice = advised(PreviewAsked(name="r", recipe=recipe(RINSED), graph=graph, declared=declared))
    assert kinds(advice) == ["add_waste"]
    after = {one["id"]: one for one in json.loads(advice["graph"])["nodes"]}
    (key,) = after.keys() - {one["id"] for one in json.loads(graph)["nodes"]}
    assert (after[key]["type"], after[key]["class"]) == ("waste", "container")
    assert after[key]["config"] == {"max_volume": 1000, "takes": ["aqueous"]}
    assert after["drain"]["config"]["takes"] == ["organic"]
    assert after["water"]["config"].get("groups") == (None if declared else ["water"])


def test_without_groups_no_waste_is_drawn_for_what_nobody_knows() -> None:
    asked = PreviewAsked(name="r", recipe=recipe(RINSED), graph=divided())
    assert {one["code"] for one in open_recipe(asked)["findings"]} == {"plan.unknown_chemistry"}
    advice = advise_on(asked)
    assert not advice["ok"]
    assert {one["code"] for one in advice["findings"]} == {"plan.no_advice"}


def test_a_second_waste_is_drawn_for_what_must_not_meet_what_is_in_the_first() -> None:
    graph = json.loads(station())
    (drain,) = (one for one in graph["nodes"] if one["id"] == "drain")
    drain["data"] = {"liquids": [["residue", 50.0]]}
    drain["config"]["groups"] = ["water_reactive"]
    raw = json.dumps(graph).encode()
    advice = advised(PreviewAsked(name="r", recipe=recipe(RINSED), graph=raw, declared=DECLARED))
    assert kinds(advice) == ["add_waste"]
    assert " that takes " not in advice["changes"][0]["text"]


def test_what_stands_in_the_station_stays_as_it_is() -> None:
    text = recipe(ADD, ADD.replace("Water", "ether"))
    before = json.loads(station())
    after = json.loads(advised(PreviewAsked(name="r", recipe=text, graph=station()))["graph"])
    kept = {one["id"]: one for one in after["nodes"]}
    for one in before["nodes"]:
        assert {**kept[one["id"]], "children": one["children"]} == one
    assert all(link in after["links"] for link in before["links"])


@pytest.mark.parametrize(
    ("steps", "hardware"),
    [
        ('<Irradiate vessel="reactor" time="1 min" wavelength="450 nm"/>', ""),
        ('<Filter vessel="filter"/>', '<Component id="filter" type="filter"/>'),
    ],
)
def test_what_a_station_has_no_class_for_is_not_drawn(steps: str, hardware: str) -> None:
    text = recipe(ADD, steps, hardware=hardware)
    advice = advise_on(PreviewAsked(name="r", recipe=text, graph=station()))
    assert not advice["ok"]
    assert {finding["code"] for finding in advice["findings"]} == {"plan.no_advice"}


def test_advice_for_a_station_in_graphml_is_written_as_json() -> None:
    graph = write_rig(read_rig(station()), RigFormat.GRAPHML)
    text = recipe(ADD, ADD.replace("Water", "ether"))
    assert kinds(advised(PreviewAsked(name="r", recipe=text, graph=graph))) == ["add_flask"]


@pytest.mark.skipif(not GRAPHS.is_dir(), reason=NO_GRAPHS)
def test_a_published_station_gets_what_recipes_want_of_it() -> None:
    path = GRAPHS / "comprehensive_protocol/comprehensive_station.json"
    bind = {"reactor": "main_reactor", "Water": "reagent_bottle_5"}
    for text, wanted in (
        (recipe(ADD, PURGE), {"add_valve", "join_gas"}),
        (recipe(REFILL, ADD), {"add_valve", "join_gas", "join_vacuum"}),
        (recipe(ADD, ADD.replace("Water", "ether")), {"add_flask", "add_valve"}),
    ):
        asked = PreviewAsked(name="r", recipe=text, graph=path.read_bytes(), bind=bind)
        assert {*kinds(advised(asked))} == wanted
