"""Published graphs of Uni-Lab-OS: each is imported without a loss, or refused for a reason."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

from fixtures.instruments.bench import parse_bench
from labweb.domain.graph.lab_file.apply_binding import apply_binding
from labweb.domain.graph.lab_file.binding_file import is_match, read_binding
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.lab_file.simulated_bench import bench_for, bench_notes, endpoints_needed
from labweb.domain.graph.lab_file.uni_lab_os.graph_read import read_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.graph_write import export_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.import_report import Row, report
from labweb.domain.graph.rig.node_classes import chemputer_sort
from tests.corpus import GRAPHS, NO_GRAPHS

ROOT = Path(__file__).parents[4]
BINDING = read_binding((ROOT / "fixtures/bindings/uni_lab_os.json").read_bytes())

pytestmark = pytest.mark.skipif(not GRAPHS.is_dir(), reason=NO_GRAPHS)

REFUSED = {
    # Two publishers of joints share the id `ot_joint_publisher`; which of them it means is open.
    "test.json": ["tree.duplicate"],
    # The nested form of older releases: no list of nodes, no positions, no links.
    "devices.json": ["lab_file.nested_form"],
    # An empty object.
    "empty_devices.json": ["lab_file.no_nodes"],
    # A list of materials and a workflow: neither describes a lab.
    "tests/resources/bioyond_materials_liquidhandling_1.json": ["lab_file.no_nodes"],
    "tests/workflow/example_prcxi.json": ["lab_file.no_nodes"],
}


@cache
def rows() -> dict[str, Row]:
    paths = sorted(GRAPHS.rglob("*.json"))
    files = {str(path.relative_to(GRAPHS)): path.read_bytes() for path in paths}
    return {row.file: row for row in report(files)}


def test_every_graph_comes_back_deep_equal_or_is_refused_for_the_known_reason() -> None:
    refused = {
        name: [finding.code for finding in row.findings]
        for name, row in rows().items()
        if row.verdict == "refused"
    }
    assert refused == REFUSED
    assert {row.verdict for row in rows().values()} == {"imported", "refused"}
    assert sum(row.verdict == "imported" for row in rows().values()) == 46


def test_no_node_and_no_link_is_lost() -> None:
    for name, row in rows().items():
        if row.verdict == "imported":
            value = json.loads((GRAPHS / name).read_bytes())
            assert row.nodes == len(value["nodes"]), name
            assert row.links == len(value.get("links", [])), name


UNMADE = {
    # Nobody states what its syringe holds.
    "mock_devices/mock_all.json": {"MockPump1": "no config.max_volume"},
    "mock_devices/mock_pump.json": {"MockPump1": "no config.max_volume"},
}
"""Nodes of a class with a device of which none can be made, and what they lack."""

BY_GRAPH = {
    "Protocol_Test_Station/add_protocol_test_station.json": 4,
    "Protocol_Test_Station/clean_vessel_protocol_test_station.json": 3,
    "Protocol_Test_Station/heatchill_protocol_test_station.json": 6,
    "comprehensive_protocol/comprehensive_station.json": 8,
    "mock_protocol/addteststation.json": 2,
    "camera.json": 1,
    "plr_test.json": 0,
}
"""Devices that are made of the nodes of a graph, counted by hand."""

ALONE = {"virtual_multiway_valve"}
"""Classes that are a device only together with another node."""


def imported() -> list[str]:
    return [name for name, row in sorted(rows().items()) if row.verdict == "imported"]


def driven() -> list[str]:
    """Return the classes that a device is made of."""
    rules = BINDING.devices
    return [one for rule in rules for classes in rule.roles.values() for one in classes]


def made_of(lab: LabFile) -> set[str]:
    """Return the keys of the nodes of the graph that a device is made of."""
    ids = {node for device in lab.devices for node in device.nodes.values()}
    return {lab.tree.by_id[one].key for one in ids if lab.tree.by_id[one].kind != "timer"}


def test_every_instrument_that_has_a_driver_here_is_one_in_every_graph() -> None:
    known = set(driven()) - ALONE
    instruments = 0
    for name in imported():
        lab, _ = bound(name)
        value = json.loads((GRAPHS / name).read_bytes())
        wanted = {
            str(node["id"])
            for node in value["nodes"]
            if any(is_match(node.get("class"), one) for one in known)
        }
        assert wanted - made_of(lab) == UNMADE.get(name, {}).keys(), name
        if name in BY_GRAPH:
            made = [device for device in lab.devices if "timer" not in device.nodes]
            assert len(made) == BY_GRAPH[name], name
        instruments += len(wanted)
    assert instruments > 60


def test_what_lacks_something_says_what() -> None:
    for name, reasons in UNMADE.items():
        _, unbound = bound(name)
        for key, reason in reasons.items():
            assert any(text.startswith(f"{key}: ") and reason in text for text in unbound), name


def test_every_class_of_a_device_is_bound_or_the_binding_says_why_not() -> None:
    for name in imported():
        for node in json.loads((GRAPHS / name).read_bytes())["nodes"]:
            sort = node.get("class")
            is_known = any(is_match(sort, one) for one in driven()) or BINDING.why_unbound(sort)
            is_driven_elsewhere = chemputer_sort(str(sort)) or name == "lidocaine-graph.json"
            assert not sort or node["type"] != "device" or is_known or is_driven_elsewhere, sort


def bound(name: str) -> tuple[LabFile, list[str]]:
    raw = (GRAPHS / name).read_bytes()
    lab, notes = apply_binding(read_uni_lab_os(raw, name), BINDING)
    assert export_uni_lab_os(lab) == json.loads(raw)
    assert read_lab(render_lab(lab)) == lab
    parse_bench(bench_for(lab, ports(lab)))
    return lab, [note.message for note in notes if note.code == "binding.unbound"]


def ports(lab: LabFile) -> dict[str, str]:
    return {
        line: f"pty:/run/line{number}" if carrier == "pty" else f"tcp:127.0.0.1:{7000 + number}"
        for number, (line, carrier) in enumerate(endpoints_needed(lab))
    }


def test_two_pumps_of_a_published_station_are_plumbed_as_drawn() -> None:
    """bottles ── valve_1 ──8──1── valve_2 ── bottles"""
    lab, _ = bound("comprehensive_protocol/comprehensive_station.json")
    bench = bench_for(lab, ports(lab))
    notes = bench_notes(lab, ports(lab))
    there = {one["id"]: one for one in bench["instruments"]}
    first, second = there["transfer_pump_1"], there["transfer_pump_2"]
    assert first["settings"] == {"syringe_ul": 25_000, "ports": 8, "address": "1"}
    assert first["attached"]["ports"]["1"] == {"vessel": "reagent_bottle_1"}
    assert first["attached"]["ports"]["8"] == {
        **{"instrument": "transfer_pump_2", "port": "1"},
        "capacity_ul": 500,
    }
    assert second["attached"]["ports"]["1"]["instrument"] == "transfer_pump_1"
    assert second["attached"]["ports"]["1"]["port"] == "8"
    assert second["attached"]["ports"]["6"] == {"vessel": "separator_1"}
    for key in ("heater_1", "stirrer_1"):
        assert there[key]["attached"] == {"vessel": "main_reactor"}
    assert there["stirrer_2"]["attached"] == {"vessel": "separator_1"}
    assert "dead_volume_ul of link_valve1_valve2: 500" in notes.assumed
    assert "density_mg_ul of DMF: 1" in notes.assumed
    assert "port 5 of transfer_pump_1: rotavap_1" in notes.unattached
