"""Keys, amounts and carried graphs of labs that come of a Chemputer graph."""

from __future__ import annotations

import json
from typing import Any

import pytest

from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.recipes.graph_formats.convert_graph import Target, convert
from tests.domain.recipes.test_wastes import two_wastes


def with_evaporator() -> dict[str, Any]:
    graph = two_wastes({})
    sizes = {"max_volume": 100, "collection_flask_volume": 100}
    graph["nodes"].append({"id": "rot", "class": "IKARV10", "type": "rotavap", **sizes})
    link = {"id": "z", "source": "rot", "target": "valve_2", "port": "(collect,0)"}
    graph["links"] = [one for one in graph["links"] if one["source"] != "flask_base"] + [link]
    return graph


def lab_of(graph: dict[str, Any]) -> dict[str, Any]:
    raw = convert(json.dumps(graph).encode(), Target.LABWEB, "x").raw
    read_lab(raw)
    return dict(json.loads(raw))


def messages(value: dict[str, Any], target: Target) -> list[str]:
    found = convert(json.dumps(value).encode(), target, "x").findings
    return [one.message for one in found]


@pytest.mark.parametrize("key", ["lab", "bench", "rot_receiver", "rot_evaporator"])
@pytest.mark.parametrize("node", ["flask_dcm", "reactor"])
def test_a_node_keeps_its_key_and_what_it_is(key: str, node: str) -> None:
    plain = with_evaporator()
    named = json.loads(json.dumps(plain).replace(f'"{node}"', f'"{key}"'))
    kinds = [{e["key"]: e["kind"] for e in lab_of(g)["resources"]} for g in (plain, named)]
    assert kinds[1][key] == kinds[0][node]
    assert sorted(kinds[1].values()) == sorted(kinds[0].values())
    joined = {
        (c["source"]["resource"], c["target"]["resource"]) for c in lab_of(named)["connections"]
    }
    assert any(key in pair for pair in joined)
    vapour = next(c for c in lab_of(named)["connections"] if c["source"]["port"] == "vapour")
    assert (vapour["source"]["resource"], vapour["target"]["resource"] != key) == ("rot", True)
    back = convert(json.dumps(lab_of(named)).encode(), Target.CHEMPUTER, "x").raw
    assert json.loads(back) == named


def test_a_lab_gives_no_graph_back_that_was_changed_in_it() -> None:
    lab = lab_of(two_wastes({}))
    lab["extra"]["chemputer"]["graph"]["nodes"][0]["chemical"] = "cyanide"
    back = convert(json.dumps(lab).encode(), Target.CHEMPUTER, "x")
    assert b"cyanide" not in back.raw


@pytest.mark.parametrize("graph", [None, 5, [1], {}, {"nodes": "x"}, {"nodes": [{"id": 1}]}])
def test_a_lab_that_carries_no_graph_is_written_by_its_classes_and_told(graph: object) -> None:
    lab = lab_of(two_wastes({}))
    if graph is None:
        del lab["extra"]["chemputer"]["graph"]
    else:
        lab["extra"]["chemputer"]["graph"] = graph
    assert "the graph that the lab carries is none" in messages(lab, Target.CHEMPUTER)[0]
    lab["extra"]["chemputer"] = 7
    assert "the graph that the lab carries is none" in messages(lab, Target.CHEMPUTER)[0]


@pytest.mark.parametrize("value", ["100 mL", -1, "abc", 1e308, True, [1]])
@pytest.mark.parametrize("name", ["max_volume", "current_volume", "volume"])
def test_what_is_no_volume_is_named(name: str, value: object) -> None:
    graph = two_wastes({})
    before = messages(graph, Target.LABWEB)
    (graph["links"] if name == "volume" else graph["nodes"])[0][name] = value
    (told,) = (one for one in messages(graph, Target.LABWEB) if one not in before)
    assert f"{name} is {value!r}, which is no volume in mL" in told


def test_what_is_no_temperature_is_named_and_an_empty_field_is_not() -> None:
    graph = with_evaporator()
    before = messages(graph, Target.LABWEB)
    graph["nodes"][-1] |= {"min_temp": "", "max_temp": "warm"}
    (told,) = (one for one in messages(graph, Target.LABWEB) if one not in before)
    assert "max_temp is 'warm', which is no temperature in °C" in told
