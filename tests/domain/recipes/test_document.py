"""Lab files of every format: told apart, read, and bound to instruments."""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path
from typing import Any

import pytest

from fixtures.instruments.bench import parse_bench
from labweb.domain.errors import LabError, LabFileError
from labweb.domain.graph.lab_file.binding_file import is_match, read_binding
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.lab_file.simulated_bench import bench_for, endpoints_needed
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.recipes.graph_formats.convert_graph import Target, convert
from labweb.domain.recipes.graph_formats.lab_of_any_format import Format, LabDocument
from tests.corpus import GRAPHS, NO_GRAPHS, NO_XDL, XDL
from tests.domain.recipes.rigs import chemputer

ROOT = Path(__file__).parents[3]
BINDINGS = {
    one: read_binding((ROOT / f"fixtures/bindings/{one}.json").read_bytes())
    for one in (Format.CHEMPUTER, Format.UNI_LAB_OS)
}
Value = dict[str, Any]


def rig(*more: str) -> Value:
    """flask ──> 2│valve_a│4 ══ 5│valve_b│0 ──> reactor,  a pump at the middle of each valve"""
    graph = chemputer(
        *("pump_a:0 = valve_a:-1", "pump_b:0 = valve_b:-1", "valve_a:4 = valve_b:5"),
        *("flask_water:0 > valve_a:2", "valve_b:0 > reactor_1:0"),
        *more,
    )
    for node in graph["nodes"]:
        if node["id"] == "flask_water":
            node |= {"chemical": "water", "current_volume": 50, "max_volume": 100}
    return graph


def joined(graph: Value, key: str, sort: str, to: str) -> Value:
    """Put an instrument beside a vessel, by a link without ports as rigs draw it."""
    graph["nodes"].append({"id": key, "class": sort})
    graph["links"].append({"id": f"at_{key}", "source": key, "target": to, "port": "(,)"})
    return graph


def bind(graph: Value) -> tuple[LabFile, list[str]]:
    document = LabDocument(json.dumps(graph).encode(), "Rig")
    lab, notes = document.bound(BINDINGS[document.format])
    return lab, [note.message for note in notes]


def drivers(lab: LabFile) -> dict[str, str]:
    found = {one.key: one.driver.rpartition(":")[2] for one in lab.devices}
    return {key: driver for key, driver in found.items() if driver != "HostTimer"}


def bench(lab: LabFile) -> dict[str, Value]:
    ports = {
        line: f"pty:/run/line{number}" if carrier == "pty" else f"tcp:127.0.0.1:{7000 + number}"
        for number, (line, carrier) in enumerate(endpoints_needed(lab))
    }
    document = bench_for(lab, ports)
    parse_bench(document)
    return {one["id"]: one for one in document["instruments"]}


def test_pumps_and_valves_of_a_chemputer_are_instruments_that_are_plumbed_as_drawn() -> None:
    lab, notes = bind(rig())
    assert notes == []
    assert drivers(lab) == {
        **dict.fromkeys(("pump_a", "pump_b"), "ChemputerPump"),
        **dict.fromkeys(("valve_a", "valve_b"), "ChemputerValve"),
    }
    there = bench(lab)
    assert there["pump_a"]["settings"] == {"syringe_ul": 25_000}
    ends = there["valve_a"]["attached"]["ports"]
    assert ends["2"] == {"vessel": "flask_water"}
    assert (ends["-1"]["instrument"], ends["-1"]["port"]) == ("pump_a", "outlet")
    assert (ends["4"]["instrument"], ends["4"]["port"]) == ("valve_b", "5")
    assert there["valve_b"]["attached"]["ports"]["0"] == {"vessel": "reactor_1"}
    # The lab counts from 1 what the valve counts from 0, and the driver is told so.
    valve = next(one for one in lab.devices if one.key == "valve_a")
    assert valve.config == {"first_port_index": 1}
    own = lab.graph.by_resource[valve.nodes["valve"]]
    assert {end.port for one in own for end in (one.source, one.target)} >= {"3", "5", "-1"}


@pytest.mark.parametrize(
    ("sort", "driver", "role"),
    [
        ("IKARCTDigital", "IkaRctDigital", "heater_stirrer"),
        ("RCTDigitalHotplate", "IkaRctDigital", "heater_stirrer"),
        ("JULABOCF41", "JulaboCf41", "thermostat"),
        ("CF41Chiller", "JulaboCf41", "thermostat"),
        ("Huber", "HuberPb", "thermostat"),
        ("HeiTORQUE_100", "HeidolphStirrer", "stirrer"),
        ("RZR_2052", "HeidolphStirrer", "stirrer"),
        ("Microstar75Stirrer", "IkaMicrostar75", "stirrer"),
    ],
)
def test_what_heats_and_stirs_a_reactor_is_an_instrument_at_it(
    sort: str, driver: str, role: str
) -> None:
    lab, notes = bind(joined(rig(), "thing", sort, "reactor_1"))
    assert notes == []
    assert drivers(lab)["thing"] == driver
    device = next(one for one in lab.devices if one.key == "thing")
    assert device.nodes == {role: lab.tree.by_key["thing"].id}
    assert bench(lab)["thing"]["attached"] == {"vessel": "reactor_1"}


def test_a_thermostat_takes_its_limits_from_the_graph_as_far_as_it_goes() -> None:
    graph = joined(rig(), "chiller", "JULABOCF41", "reactor_1")
    graph["nodes"][-1] |= {"min_temp": "-20", "max_temp": 250}
    lab, notes = bind(graph)
    (chiller,) = (one for one in lab.devices if one.key == "chiller")
    limits = chiller.config["min_temperature_c"], chiller.config["max_temperature_c"]
    assert limits == (-20.0, 200.0)
    assert notes == ["max_temp is 250, and the instrument ends at 200: that is taken"]


def test_an_evaporator_is_the_instrument_that_its_flask_turns_on() -> None:
    graph = rig("valve_b:1 = rotavap_1:evaporate", "rotavap_1:collect > valve_b:2")
    for node in graph["nodes"]:
        if node["id"] == "rotavap_1":
            node |= {"max_volume": 250, "collection_flask_volume": 500}
    lab, _ = bind(joined(graph, "vacuum_pump", "CVC3000", "rotavap_1"))
    (evaporator,) = (one for one in lab.devices if one.driver.endswith("IkaRv10Digital"))
    node = lab.tree.by_id[evaporator.nodes["rotary_evaporator"]]
    assert node.kind == "rotary_evaporator"
    assert [child.key for child in lab.tree.children[node.id]] == ["rotavap_1"]
    there = bench(lab)
    assert there[evaporator.key]["attached"] == {"vessel": "rotavap_1"}
    assert there["vacuum_pump"]["attached"] == {"vessel": "rotavap_1"}


def test_a_vacuum_controller_acts_through_the_line_that_it_is_joined_to() -> None:
    graph = rig("filter_1:bottom = valve_c:-1", "valve_c:1 = vacuum_line:0")
    lab, _ = bind(joined(graph, "controller", "CVC3000VacuumPump", "vacuum_line"))
    device = next(one for one in lab.devices if one.key == "controller")
    keys = {role: lab.tree.by_id[node].key for role, node in device.nodes.items()}
    assert keys == {"vacuum_controller": "controller", "line": "vacuum_line"}
    line = lab.tree.by_key["vacuum_line"].id
    assert {way.medium for way in lab.graph.by_resource[line]} == {Medium.GAS, Medium.VACUUM}


def test_what_has_no_driver_says_why_and_two_tubes_at_one_port_are_named() -> None:
    graph = joined(rig("flask_b:0 > valve_a:2"), "thing", "PneumaticController", "reactor_1")
    lab, notes = bind(graph)
    assert "valve_a" not in drivers(lab)
    assert any("port '3' of valve_a has 2 tubes" in note for note in notes)
    assert "thing" not in drivers(lab)


@pytest.mark.parametrize("target", [Target.CHEMPUTER_GRAPHML, Target.CHEMPUTER_YED])
def test_graphml_packed_or_not_is_the_same_lab(target: Target) -> None:
    plain, _ = bind(rig())
    raw = convert(json.dumps(rig()).encode(), target, "Rig").raw
    for given in (raw, gzip.compress(raw)):
        document = LabDocument(given, "Rig")
        assert document.format is Format.CHEMPUTER
        assert document.bound(BINDINGS[Format.CHEMPUTER])[0] == plain


def test_graphml_of_a_station_is_the_same_lab() -> None:
    flask: Value = {"id": "flask", "type": "container", "class": "", "config": {"max_volume": 5}}
    pump: Value = {"id": "pump", "type": "device", "class": "virtual_transfer_pump"}
    raw = json.dumps({"nodes": [flask, pump], "links": []}).encode()
    graphml = convert(raw, Target.UNI_LAB_OS_GRAPHML, "Station").raw
    document = LabDocument(graphml, "Station")
    assert document.format is Format.UNI_LAB_OS
    assert document.read() == LabDocument(raw, "Station").read()


def test_formats_are_told_apart_by_what_is_in_them() -> None:
    document = LabDocument(json.dumps(rig()).encode(), "Rig")
    assert document.format is Format.CHEMPUTER
    rendered = render_lab(document.read())
    assert LabDocument(rendered, "ignored").format is Format.LABWEB
    assert LabDocument(rendered, "ignored").read() == document.read()
    for raw in (b"<a/>", b"{", b"\x1f\x8bno gzip"):
        with pytest.raises(LabFileError):
            LabDocument(raw, "x").read()


def rigs() -> list[Path]:
    found = {*XDL.rglob("*.json"), *XDL.rglob("*.graphml"), *XDL.rglob("*.graphml.gz")}
    station = GRAPHS / "lidocaine-graph.json"
    return sorted(path for path in {*found, station} if path.is_file())


@pytest.mark.skipif(not XDL.is_dir(), reason=NO_XDL)
@pytest.mark.skipif(not GRAPHS.is_dir(), reason=NO_GRAPHS)
def test_every_instrument_of_a_published_rig_that_has_a_driver_here_is_one() -> None:
    binding = BINDINGS[Format.CHEMPUTER]
    driven = [one for rule in binding.devices for one in next(iter(rule.roles.values()))]
    bound, missing, refused = 0, [], []
    for path in rigs():
        try:
            document = LabDocument(path.read_bytes(), path.stem)
            if document.format is not Format.CHEMPUTER:
                continue
            lab, notes = document.bound(binding)
        except LabError as error:
            refused.append([one.code for one in error.findings])
            continue
        bench(lab)
        assert read_lab(render_lab(lab)) == lab
        ids = {node for device in lab.devices for node in device.nodes.values()}
        told = " ".join(note.message for note in notes)
        for key, sort in document.classes().items():
            if any(is_match(sort, one) for one in driven):
                place = lab.tree.by_key[key]
                bound += 1
                if not ids & {place.id, place.parent_id}:
                    missing.append(key)
                    assert re.search(rf"of {re.escape(key)} has [23] tubes", told), (path, key)
            else:
                assert binding.why_unbound(sort), (path, sort)
    assert refused == [["graph.duplicate_id"]]
    assert bound > 1200
    assert len(missing) < 30
