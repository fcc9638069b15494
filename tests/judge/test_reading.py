"""Every form of graph file is read into the same hoses."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import pytest

from tests.judge.invent import same_rig_in_three_forms
from tests.judge.reading import NoGraphError, read_json, read_rig
from tests.judge.rig import Kind, Rig


def hoses(rig: Rig) -> set[tuple[frozenset[tuple[tuple[str, str], bool]]]]:
    """Return each hose as its two ends and whether liquid may leave there."""
    return {
        (frozenset(((hose.a, hose.is_forward), (hose.b, hose.is_backward))),) for hose in rig.hoses
    }


def chemputer(links: list[dict[str, Any]], *names: str) -> Rig:
    classes = {"v": "ChemputerValve", "p": "ChemputerPump", "f": "ChemputerFlask"}
    nodes = [{"id": name, "class": classes[name[0]], "max_volume": 5} for name in names]
    return read_json({"nodes": nodes, "links": links})


def unilab(link: dict[str, Any], valve_class: str = "virtual_multiway_valve") -> Rig:
    nodes = [
        {"id": "v", "type": "device", "class": valve_class, "config": {"positions": 8}},
        {"id": "f", "type": "container", "class": None},
    ]
    return read_json({"nodes": nodes, "links": [{"source": "v", "target": "f", **link}]})


@pytest.mark.parametrize("seed", range(30))
def test_three_forms_of_one_rig_are_read_alike(seed: int, tmp_path: Path) -> None:
    rigs = []
    for form, text in same_rig_in_three_forms(seed).items():
        path = tmp_path / f"{form}.{'json' if form == 'json' else 'graphml'}"
        path.write_text(text, "utf-8")
        rigs.append(read_rig(path))
    assert hoses(rigs[0]) == hoses(rigs[1]) == hoses(rigs[2])
    assert rigs[0].devices == rigs[1].devices == rigs[2].devices
    assert not any(rig.faults for rig in rigs)


def test_an_edge_of_the_chemputer_goes_one_way_and_two_make_a_tube() -> None:
    there = {"source": "f", "target": "v", "port": "(0,3)"}
    back = {"source": "v", "target": "f", "port": "( 3 , 0 )"}
    rig = chemputer([there], "f", "v")
    assert [(hose.is_forward, hose.is_backward) for hose in rig.hoses] == [(True, False)]
    rig = chemputer([there, back, there], "f", "v")
    assert [(hose.is_forward, hose.is_backward) for hose in rig.hoses] == [(True, True)]


def test_bare_ports_of_2018_belong_to_the_valve_and_valves_share_one_tube() -> None:
    links: list[dict[str, Any]] = [
        {"source": "p", "target": "v1"},
        {"source": "v1", "target": "f", "port": 4},
        {"source": "v1", "target": "v2", "port": 1},
        {"source": "v2", "target": "v1", "port": 2},
    ]
    rig = chemputer(links, "p", "v1", "v2", "f")
    ends = {frozenset((hose.a, hose.b)) for hose in rig.hoses}
    assert ends == {
        frozenset((("p", ""), ("v1", "-1"))),
        frozenset((("v1", "4"), ("f", ""))),
        frozenset((("v1", "1"), ("v2", "2"))),
    }
    assert all(hose.is_forward and hose.is_backward for hose in rig.hoses)


@pytest.mark.parametrize(("port", "is_hose"), [("(,)", False), ("(0,0)", True), ("(,0)", True)])
def test_what_a_device_acts_on_is_no_hose(port: str, is_hose: bool) -> None:
    nodes = [{"id": "p", "class": "ChemputerPump"}, {"id": "s", "class": "BubbleSensor"}]
    rig = read_json({"nodes": nodes, "links": [{"source": "s", "target": "p", "port": port}]})
    assert bool(rig.hoses) is is_hose
    assert bool(rig.dry_ends) is not is_hose


def test_a_forgotten_port_of_the_plumbing_stays_a_hose() -> None:
    rig = chemputer([{"source": "f", "target": "v", "port": "(,)"}], "f", "v")
    assert rig.hoses


@pytest.mark.parametrize(
    "link",
    [
        {"type": "fluid", "port": {"v": "3", "f": "top"}},
        {"type": "physical", "port": "(3,top)"},
        {"type": "fluid", "sourceHandle": "3", "targetHandle": "top"},
    ],
)
def test_ports_of_uni_lab_os_are_read_in_every_form(link: dict[str, Any]) -> None:
    rig = unilab(link)
    assert {rig.hoses[0].a, rig.hoses[0].b} == {("v", "3"), ("f", "top")}


@pytest.mark.parametrize("port", ["3", 3])
def test_a_bare_port_is_the_valves(port: object) -> None:
    assert unilab({"type": "fluid", "port": port}).hoses[0].a == ("v", "3")


@pytest.mark.parametrize(
    "medium", ["communication", "mechanical", "thermal", "transport", "resource", "logical", None]
)
def test_liquid_runs_on_no_other_medium(medium: str | None) -> None:
    rig = unilab({"type": medium, "port": {"v": "3", "f": "top"}})
    assert not rig.hoses
    assert rig.dry_ends[("v", "3")] == (medium or "nothing stated")


@pytest.mark.parametrize(
    ("class_name", "kind"),
    [
        ("virtual_multiway_valve", Kind.VALVE),
        ("virtual_solenoid_valve", Kind.SOLENOID),
        ("virtual_transfer_pump", Kind.PUMP),
        ("syringepump.runze", Kind.PUMP),
        ("syringe_pump_with_valve.runze.SY03B-T08", Kind.PUMP_VALVE),
        ("virtual_vacuum_pump", Kind.OTHER),
        ("virtual_gas_source", Kind.OTHER),
        ("virtual_rotavap", Kind.VESSEL),
        ("virtual_separator", Kind.VESSEL),
        ("virtual_column", Kind.OTHER),
        ("serial", Kind.OTHER),
        ("workstation", Kind.OTHER),
        (None, Kind.OTHER),
    ],
)
def test_a_node_of_uni_lab_os_is_what_its_class_says(class_name: str | None, kind: Kind) -> None:
    node = {"id": "v", "type": "device", "class": class_name}
    ends = [{"source": "v", "target": t, "type": "fluid", "port": {"v": t}} for t in "ab"]
    held = [{"id": name, "type": "container", "class": "valve pump"} for name in "ab"]
    rig = read_json({"nodes": [node, *held], "links": ends})
    assert rig.devices["v"].kind is kind
    assert rig.vessels()[-2:] == ["a", "b"]


def test_faults_of_a_file_are_listed() -> None:
    rig = chemputer(
        [
            {"source": "f1", "target": "v", "port": "(0,6)"},
            {"source": "f1", "target": "v", "port": "(0,2)"},
            {"source": "f2", "target": "v", "port": "(0,2)"},
            {"source": "f2", "target": "ghost", "port": "(0,2)"},
        ],
        *("f1", "f2", "v", "f1"),
    )
    assert rig.faults == (
        "node id f1 is used twice",
        "a link ends at ghost, which is no node",
        "v has no port 6",
        "port 2 of v has hoses to f1 and f2",
    )


def test_a_packed_file_is_read_and_a_list_is_no_graph(tmp_path: Path) -> None:
    nodes = {"nodes": [{"id": "f", "class": "ChemputerFlask"}], "links": []}
    packed = tmp_path / "a.json.gz"
    packed.write_bytes(gzip.compress(json.dumps(nodes).encode()))
    assert read_rig(packed).vessels() == ["f"]
    with pytest.raises(NoGraphError):
        read_json([])
