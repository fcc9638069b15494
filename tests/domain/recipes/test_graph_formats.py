"""Physical graphs in other formats: what is written reads back, and what is lost has a name."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.errors import LabError
from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.rig.rig_model import RigFormat
from labweb.domain.graph.rig.rig_read import read_rig, unpacked
from labweb.domain.graph.rig.rig_write import write_rig
from labweb.domain.recipes.graph_formats.convert_graph import Target, convert, family_of
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.recipe_preview import PreviewAsked, open_recipe
from tests.corpus import GRAPHS, NO_GRAPHS, NO_XDL, XDL
from tests.domain.recipes.rigs import chemputer
from tests.domain.recipes.test_advice_on_labs import ADD, SEPARATE, SEPARATOR, recipe
from tests.domain.recipes.test_advice_on_stations import station
from tests.domain.recipes.test_opening import RECIPE, ROW, STARTER
from tests.domain.workflows.station import LAB

SYNTHESIS = (LAB / "lab.json").read_bytes()


def plain(raw: bytes) -> Any:  # noqa: ANN401 - what JSON can hold
    return json.loads(raw)


def nodes(raw: bytes, target: Target = Target.CHEMPUTER) -> dict[str, dict[str, Any]]:
    graph = plain(convert(raw, target, "x").raw)
    return {node["id"]: node for node in graph["nodes"]}


def told(raw: bytes, target: Target) -> dict[str, str]:
    found: dict[str, str] = {}
    for one in convert(raw, target, "x").findings:
        found[one.subject] = f"{found.get(one.subject, '')} {one.message}"
    return found


@pytest.mark.parametrize("raw", [ROW, station(), STARTER, SYNTHESIS])
@pytest.mark.parametrize("target", list(Target))
def test_every_format_is_written_as_one_that_is_read(raw: bytes, target: Target) -> None:
    found = convert(raw, target, "Converted")
    rig = read_rig(found.raw)
    assert family_of(rig) == target.family
    assert all(one.code == "graph.not_held" for one in found.findings)
    is_same = family_of(read_rig(raw)) == target.family
    assert is_same == (not found.findings)


@pytest.mark.parametrize(
    ("raw", "target"),
    [
        (ROW, Target.CHEMPUTER),
        (ROW, Target.CHEMPUTER_GRAPHML),
        (ROW, Target.CHEMPUTER_YED),
        (station(), Target.UNI_LAB_OS),
        (station(), Target.UNI_LAB_OS_GRAPHML),
    ],
)
def test_another_syntax_and_back_is_the_same_graph(raw: bytes, target: Target) -> None:
    there = convert(raw, target, "x")
    assert plain(convert(there.raw, Target(target.family), "x").raw) == plain(raw)


def test_what_yed_draws_has_each_node_as_a_box_with_its_id() -> None:
    text = convert(ROW, Target.CHEMPUTER_YED, "x").raw.decode()
    for node in plain(ROW)["nodes"]:
        assert f"<y:NodeLabel>{node['id']}</y:NodeLabel>" in text
    again = convert(text.encode(), Target.CHEMPUTER_YED, "x")
    assert again.raw.decode() == text
    (lost,) = convert(text.encode(), Target.CHEMPUTER, "x").findings
    assert lost.subject == "the drawing"


def test_a_chemputer_graph_is_a_lab_on_which_the_recipe_is_proved() -> None:
    full = plain(ROW)
    for node in full["nodes"]:
        if node.get("chemical"):
            node["current_volume"] = node["max_volume"]
    row = json.dumps(full).encode()
    raw = convert(row, Target.LABWEB, "Row").raw
    assert read_lab(raw).name == "Row"
    answer = open_recipe(PreviewAsked(name="r", recipe=RECIPE, graph=raw))
    own = open_recipe(PreviewAsked(name="r", recipe=RECIPE, graph=row))
    assert (answer["findings"], answer["is_proved"]) == ([], True)
    assert answer["plan"]["totals"]["delivered_ul"] == own["plan"]["totals"]["delivered_ul"]


def test_a_label_of_an_empty_flask_is_told_for_a_lab_says_by_contents_what_is_in_one() -> None:
    assert "holds nothing that is known" in told(ROW, Target.LABWEB)["flask_water"]


def test_a_lab_is_a_chemputer_graph_on_which_the_recipe_is_proved() -> None:
    raw = convert(STARTER, Target.CHEMPUTER, "x").raw
    asked = PreviewAsked(name="r", recipe=recipe(ADD), graph=STARTER)
    for graph in (STARTER, raw):
        answer = open_recipe(replace(asked, graph=graph))
        assert (answer["findings"], answer["is_proved"]) == ([], True), answer["findings"]


def test_a_station_is_a_chemputer_graph_on_which_the_recipe_is_proved() -> None:
    raw = convert(station(), Target.CHEMPUTER, "x").raw
    answer = open_recipe(PreviewAsked(name="r", recipe=recipe(ADD), graph=raw))
    assert (answer["findings"], answer["is_proved"]) == ([], True)


def test_a_lab_that_was_not_changed_gives_its_chemputer_graph_back() -> None:
    lab = convert(ROW, Target.LABWEB, "Row").raw
    back = convert(lab, Target.CHEMPUTER, "x")
    assert (plain(back.raw), back.findings) == (plain(ROW), ())
    changed = plain(lab)
    for entry in changed["resources"]:
        if entry["kind"] == "reactor":
            entry["config"]["capacity_ul"] = 123_000
    found = nodes(json.dumps(changed).encode())
    assert 123 in {node.get("max_volume") for node in found.values()}


def test_an_evaporator_is_one_node_with_its_receiver_and_its_pump() -> None:
    graph = plain(convert(SYNTHESIS, Target.CHEMPUTER, "x").raw)
    found = {node["id"]: node for node in graph["nodes"]}
    flask = found["rotavap_flask"]
    assert (flask["class"], flask["collection_flask_volume"]) == ("IKARV10", 1000)
    assert not {"rotavap", "rotavap_receiver"} & found.keys()
    assert found["vacuum_rotavap"]["class"] == "CVC3000"
    assert found["vacuum_line"]["class"] == "ChemputerVacuum"
    assert found["argon"]["chemical"] == "argon"
    joined = {(link["source"], link["target"], link["port"]) for link in graph["links"]}
    assert ("vacuum_rotavap", "rotavap_flask", "(,)") in joined
    assert any(one == "rotavap_flask" and port.startswith("(collect,") for one, _, port in joined)


def test_a_vacuum_line_with_its_controller_stays_a_line() -> None:
    graph = chemputer("filter_1:bottom > valve_1:-1", "valve_1:5 > vacuum_1:0")
    graph["nodes"].append({"id": "cvc", "class": "CVC3000", "type": "vacuum"})
    graph["links"] += [
        {"id": 10, "source": "cvc", "target": "vacuum_1", "port": "(,)"},
        {"id": 11, "source": "cvc", "target": "filter_1", "port": "(,)"},
    ]
    lab = convert(json.dumps(graph).encode(), Target.LABWEB, "Line").raw
    kinds = {one["key"]: one["kind"] for one in plain(lab)["resources"]}
    assert (kinds["vacuum_1"], kinds["cvc"]) == ("vacuum_line", "vacuum_controller")
    assert Equipment(read_rig(lab)).vacuum_pump("vacuum_1") == "cvc"
    back = nodes(lab)
    assert (back["vacuum_1"]["class"], back["cvc"]["class"]) == ("ChemputerVacuum", "CVC3000")
    assert "vacuum_1_pump" not in back
    alone = chemputer("filter_1:bottom > valve_1:-1", "valve_1:5 > vacuum_1:0")
    lab = convert(json.dumps(alone).encode(), Target.LABWEB, "Line").raw
    kinds = {one["key"]: one["kind"] for one in plain(lab)["resources"]}
    assert kinds["vacuum_1"] == "vacuum_controller"


def test_a_tube_at_a_port_that_the_class_does_not_have_is_left_out_and_told() -> None:
    lost = told(SYNTHESIS, Target.CHEMPUTER)
    assert "its port 7 of valve_1 is none of a ChemputerValve" in lost["valve_1_7_reactor"]
    assert "a Chemputer graph does not hold devices" in " ".join(lost.values())
    assert "bench_1" in lost
    links = plain(convert(SYNTHESIS, Target.CHEMPUTER, "x").raw)["links"]
    assert not any(link["port"].startswith("(7,") or ",7)" in link["port"] for link in links)


def test_two_substances_in_one_vessel_are_not_held_by_a_chemputer_graph() -> None:
    value = plain(station())
    (water,) = (node for node in value["nodes"] if node["id"] == "water")
    water["data"]["liquids"] = [["Water", 1.0], ["THF", 2.0]]
    raw = json.dumps(value).encode()
    messages = [one.message for one in convert(raw, Target.CHEMPUTER, "x").findings]
    assert any("this holds Water, THF" in message for message in messages)
    assert "chemical" not in nodes(raw)["water"]


def test_what_a_station_cannot_hold_of_a_lab_is_named() -> None:
    lost = told(SYNTHESIS, Target.UNI_LAB_OS)
    assert "say nothing of gas" in " ".join(lost.values())
    assert "has no direction" in " ".join(lost.values())
    assert "the lab" in lost


def test_what_is_no_graph_is_refused() -> None:
    for raw in (b"{}", b"<a/>", b"no graph", b'{"nodes": 7}'):
        with pytest.raises(LabError):
            convert(raw, Target.LABWEB, "x")


def test_a_separator_keeps_its_two_sides_and_a_recipe_parts_in_it() -> None:
    text = recipe(ADD, SEPARATE, hardware=SEPARATOR).replace(b"ether", b"diethyl ether")
    found = nodes(SYNTHESIS)["separator"]
    assert found["class"] == "ChemputerSeparator"
    assert b"diethyl ether" in text
    links = plain(convert(SYNTHESIS, Target.CHEMPUTER, "x").raw)["links"]
    ports = {link["port"] for link in links if link["source"] == "separator"}
    assert any(port.startswith("(bottom,") for port in ports)


def graphs(folder: Path) -> list[Path]:
    found = [*folder.rglob("*.json"), *folder.rglob("*.graphml")]
    return sorted(path for path in found if path.stat().st_size < 200_000)


def readable(path: Path) -> bytes | None:
    try:
        raw = unpacked(path.read_bytes())
        return raw if read_rig(raw).tubes else None
    except LabError:
        return None


@pytest.mark.parametrize(
    "folder",
    [
        pytest.param(
            XDL / "chempiler_graphs", marks=pytest.mark.skipif(not XDL.is_dir(), reason=NO_XDL)
        ),
        pytest.param(GRAPHS, marks=pytest.mark.skipif(not GRAPHS.is_dir(), reason=NO_GRAPHS)),
    ],
    ids=["chemputer", "uni-lab-os"],
)
def test_published_graphs_come_back_from_every_syntax_and_from_a_lab(folder: Path) -> None:
    count = 0
    for path in graphs(folder):
        raw = readable(path)
        if raw is None:
            continue
        rig = read_rig(raw)
        family = Target(family_of(rig))
        own = plain(write_rig(rig, RigFormat.NODE_LINK))
        for target in Target:
            found = convert(raw, target, path.stem)
            read_rig(found.raw)
            if target.family == family.value or target is Target.LABWEB:
                assert plain(convert(found.raw, family, "x").raw) == own, (path.name, target)
        count += 1
    assert count > 5


def test_a_lab_as_a_station_says_how_much_is_held_in_millilitres() -> None:
    raw = convert(STARTER, Target.UNI_LAB_OS, "x").raw
    config = {one["id"]: one["config"] for one in plain(raw)["nodes"]}
    assert config["pump_1"]["max_volume"] == 5
    assert config["reactor_1"]["max_volume"] == 100
    assert not any("capacity_ul" in one for one in config.values())
    pumps = {
        one.key: one.capacity_nl for one in read_rig(raw).elements if one.role is ElementRole.PUMP
    }
    assert pumps == {"pump_1": 5_000_000, "pump_2": 5_000_000}
    back = plain(convert(raw, Target.LABWEB, "x").raw)
    (reactor,) = (one for one in back["resources"] if one["key"] == "reactor_1")
    assert reactor["config"]["capacity_ul"] == 100_000


@pytest.mark.parametrize("target", list(Target))
def test_a_lab_without_connections_is_converted(target: Target) -> None:
    lab = plain(STARTER)
    del lab["connections"]
    assert convert(json.dumps(lab).encode(), target, "x").raw
