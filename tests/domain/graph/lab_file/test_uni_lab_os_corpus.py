"""Published graphs of Uni-Lab-OS: each is imported without a loss, or refused for a reason."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

from labweb.domain.graph.lab_file.bench import bench_for, bench_notes, endpoints_needed
from labweb.domain.graph.lab_file.bind import apply_binding
from labweb.domain.graph.lab_file.bindings import read_binding
from labweb.domain.graph.lab_file.model import LabFile
from labweb.domain.graph.lab_file.read import read_lab
from labweb.domain.graph.lab_file.render import render_lab
from labweb.domain.graph.lab_file.uni_lab_os.export import export_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.reader import read_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.report import Row, report
from tests.corpus import GRAPHS, NO_GRAPHS

ROOT = Path(__file__).parents[4]
BINDING = read_binding((ROOT / "fixtures/bindings/uni_lab_os.json").read_bytes())

pytestmark = pytest.mark.skipif(not GRAPHS.is_dir(), reason=NO_GRAPHS)

REFUSED = {
    # Two publishers of joints share the id `ot_joint_publisher`; which of them it means is open.
    "test.json": ["tree.duplicate"],
    # The deck names `lh_PRCXI_Deck`, which is in no file, while `PRCXI` lists it as its child.
    "large/prcxi_9320_visual.json": ["tree.dangling_parent", "tree.two_parents"],
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
    assert sum(row.verdict == "imported" for row in rows().values()) == 45


def test_no_node_and_no_link_is_lost() -> None:
    for name, row in rows().items():
        if row.verdict == "imported":
            value = json.loads((GRAPHS / name).read_bytes())
            assert row.nodes == len(value["nodes"]), name
            assert row.links == len(value.get("links", [])), name


def bound(name: str) -> tuple[LabFile, list[str]]:
    raw = (GRAPHS / name).read_bytes()
    lab, notes = apply_binding(read_uni_lab_os(raw, name), BINDING)
    assert export_uni_lab_os(lab) == json.loads(raw)
    assert read_lab(render_lab(lab)) == lab
    assert bench_for(lab, dict(endpoints_needed(lab)))["schema"] == "labweb.bench/1"
    return lab, [note.message for note in notes if note.code == "binding.unbound"]


@pytest.mark.parametrize(
    ("name", "devices", "unbound_count"),
    [
        ("Protocol_Test_Station/add_protocol_test_station.json", 2, 2),
        ("Protocol_Test_Station/dual_valve_pump_test_station.json", 2, 0),
        ("Protocol_Test_Station/heatchill_protocol_test_station.json", 4, 0),
        ("Protocol_Test_Station/pumptransfer_test_station.json", 1, 0),
        ("Protocol_Test_Station/simple_stir_heatchill_test_station.json", 1, 0),
        # One heater is linked to two vessels and has no stirrer.
        ("Protocol_Test_Station/clean_vessel_protocol_test_station.json", 2, 1),
        # stirrer_2 is at the separator, which has no heater.
        ("comprehensive_protocol/comprehensive_station.json", 3, 1),
        # The pump is joined by a link of type physical, which says nothing of a tube.
        ("mock_protocol/addteststation.json", 0, 3),
        ("lidocaine-graph.json", 0, 0),
    ],
)
def test_devices_are_made_only_where_everything_is_there(
    name: str, devices: int, unbound_count: int
) -> None:
    lab, unbound = bound(name)
    assert len(lab.devices) == devices
    assert len(unbound) == unbound_count


def test_two_pumps_of_a_published_station_are_plumbed_as_drawn() -> None:
    """bottles ── valve_1 ──8──1── valve_2 ── bottles"""
    lab, _ = bound("comprehensive_protocol/comprehensive_station.json")
    bench = bench_for(lab, dict(endpoints_needed(lab)))
    notes = bench_notes(lab, dict(endpoints_needed(lab)))
    first, second, heater = bench["instruments"]
    assert first["settings"] == {"syringe_ul": 25_000, "ports": 8, "address": "1"}
    assert first["attached"]["ports"]["1"] == {"vessel": "reagent_bottle_1"}
    assert first["attached"]["ports"]["8"] == {
        **{"instrument": "transfer_pump_2", "port": "1"},
        "capacity_ul": 500,
    }
    assert second["attached"]["ports"]["1"]["instrument"] == "transfer_pump_1"
    assert second["attached"]["ports"]["1"]["port"] == "8"
    assert heater["attached"] == {"vessel": "main_reactor"}
    assert "dead_volume_ul of link_valve1_valve2: 500" in notes.assumed
    assert "density_mg_ul of DMF: 1" in notes.assumed
    assert "port 5 of transfer_pump_1: rotavap_1" in notes.unattached
