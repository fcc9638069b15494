from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.errors import LabFileError
from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.rig.rig_model import Rig, RigFormat
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.graph.rig.rig_write import write_rig
from tests.corpus import GRAPHS, NO_XDL, XDL

ROOT = Path(__file__).parents[4]

GRAPHML = """<?xml version="1.0"?>
<graphml xmlns="http://graphml.graphdrawing.org/xmlns" xmlns:y="http://www.yworks.com/xml/graphml">
  <key id="c" for="node" attr.name="class" attr.type="string"/>
  <key id="v" for="node" attr.name="max_volume" attr.type="double"><default>-1.0</default></key>
  <key id="g" for="node" yfiles.type="nodegraphics"/>
  <key id="p" for="edge" attr.name="port" attr.type="{type}">{default}</key>
  <graph edgedefault="directed">
    <node id="n0"><data key="c">{pump}</data><data key="v">25.0</data></node>
    <node id="n1"><data key="c">{valve}</data>
      <data key="g"><y:ImageNode><y:NodeLabel> valve_1
        <y:LabelModel/></y:NodeLabel></y:ImageNode></data></node>
    <node id="n2"><data key="c">{flask}</data></node>
    {edges}
  </graph>
</graphml>"""


def refusal(raw: bytes) -> LabFileError:
    with pytest.raises(LabFileError) as caught:
        read_rig(raw)
    return caught.value


def node_link(nodes: list[Any], links: list[Any], **top: object) -> bytes:
    return json.dumps({"nodes": nodes, "links": links, **top}).encode()


def ports_of(rig: Rig) -> list[tuple[str, str, str, str, bool]]:
    return [(t.source, t.source_port, t.target, t.target_port, t.is_two_way) for t in rig.tubes]


def test_a_chemputer_link_conducts_as_it_is_drawn_between_two_named_ports() -> None:
    nodes = [{"id": "f", "class": "ChemputerFlask"}, {"id": 7, "class": "ChemputerValve"}]
    rig = read_rig(node_link(nodes, [{"source": "f", "target": 7, "port": "(0, 3 )"}]))
    assert ports_of(rig) == [("f", "0", "7", "3", False)]
    assert [element.role for element in rig.elements] == [ElementRole.VESSEL, ElementRole.VALVE]


@pytest.mark.parametrize(
    ("name", "medium"),
    [
        ("HeiTORQUE_100", Medium.MECHANICAL),
        ("JULABOCF41", Medium.THERMAL),
        ("IKARCTDigital", Medium.THERMAL),
        ("ConductivitySensor", Medium.ELECTRICAL),
        ("CVC3000", Medium.VACUUM),
        ("ChemputerVacuum", Medium.VACUUM),
        ("PneumaticController", Medium.GAS),
        ("ChemputerFlask", Medium.LIQUID),
        ("IKARV10", Medium.LIQUID),
    ],
)
def test_a_chemputer_link_carries_what_it_is_joined_to(name: str, medium: Medium) -> None:
    nodes = [{"id": "x", "class": name}, {"id": "r", "class": "ChemputerReactor"}]
    rig = read_rig(node_link(nodes, [{"source": "x", "target": "r", "port": "(,)"}]))
    assert rig.tubes[0].medium is medium


def test_a_uni_lab_os_link_carries_what_its_type_says_and_conducts_both_ways() -> None:
    nodes = [{"id": "a", "type": "container"}, {"id": "s", "class": "virtual_stirrer"}]
    types = ("fluid", "mechanical", "communication", "transport", "logical", "physical", None)
    links = [{"source": "s", "target": "a", "type": t, "port": {"a": "top", "s": 1}} for t in types]
    rig = read_rig(node_link([*nodes, {"id": "b", "type": "container"}], links))
    media = [tube.medium.value for tube in rig.tubes]
    assert media == [
        "mechanical", "mechanical", "communication", "transport", "other", "mechanical", "other",
    ]  # fmt: skip
    assert ports_of(rig)[0] == ("s", "1", "a", "top", True)


@pytest.mark.parametrize(
    ("links", "common"),
    [
        ([("p", "x", "transferpump"), ("a", "top", "1")], "transferpump"),
        ([("p", "x", "multiway-valve-inlet"), ("a", "top", "1")], "multiway-valve-inlet"),
        ([("p", "x", "0"), ("a", "top", "1")], "0"),
        ([("p", "x", "4"), ("a", "top", "common")], "common"),
        ([("p", "x", "1"), ("p", "y", "2")], None),
        ([("q", "3", "4"), ("a", "top", "1")], None),
        ([("q", "3", "4"), ("p", "x", "2")], "2"),
        ([("a", "top", "1")], None),
    ],
)
def test_the_common_port_is_named_or_joined_to_the_pump(
    links: list[tuple[str, str, str]], common: str | None
) -> None:
    nodes = [
        {"id": "v", "class": "virtual_multiway_valve"},
        {"id": "p", "class": "virtual_transfer_pump", "config": {"max_volume": 25.0}},
        {"id": "q", "class": "syringe_pump_with_valve.runze.SY03B-T08"},
        {"id": "a", "type": "container", "class": None},
    ]
    drawn = [
        {"source": "v", "target": far, "type": "fluid", "port": {"v": own, far: port}}
        for far, port, own in links
    ]
    rig = read_rig(node_link(nodes, drawn))
    assert rig.elements[0].common_port == common


def test_a_name_says_nothing_about_what_a_node_is() -> None:
    nodes = [{"id": "pump_1", "type": "device", "class": ""}, {"id": "valve", "type": "container"}]
    rig = read_rig(node_link(nodes, []))
    assert [element.role for element in rig.elements] == [ElementRole.OTHER, ElementRole.VESSEL]


def test_every_defect_of_a_graph_is_told_at_once() -> None:
    nodes = [{"id": "a"}, {"id": "a"}, {"name": "b"}, 3]
    links = [{"id": "l", "source": "a", "target": "z"}, "x"]
    error = refusal(node_link(nodes, links))
    assert sorted(finding.code for finding in error.findings) == [
        "graph.dangling_link",
        "graph.duplicate_id",
        "lab_file.node_id",
        "lab_file.shape",
        "lab_file.shape",
    ]


def test_a_tube_at_a_port_that_does_not_exist_is_kept_and_never_routed() -> None:
    nodes = [{"id": "f", "class": "ChemputerFlask"}, {"id": "v", "class": "ChemputerValve"}]
    raw = node_link(nodes, [{"id": 3, "source": "f", "target": "v", "port": "(0,6)"}])
    rig = read_rig(raw)
    (defect,) = rig.defects
    assert (defect.code, defect.subject) == ("graph.bad_port", "3")
    assert rig.network.arcs == [[], []]
    assert json.loads(write_rig(rig)) == json.loads(raw)


def graphml(edges: str, **words: str) -> bytes:
    given = {"type": "string", "default": "", "pump": "ChemputerPump", "valve": "ChemputerValve"}
    given |= {"flask": "ChemputerFlask", **words}
    return GRAPHML.format(edges=edges, **given).encode()


def test_the_label_that_yed_draws_is_the_id() -> None:
    edge = '<edge id="e0" source="n2" target="n1"><data key="p">(0,2)</data></edge>'
    rig = read_rig(graphml(edge))
    assert ports_of(rig) == [("n2", "0", "valve_1", "2", False)]
    assert rig.elements[0].capacity_nl == 25_000_000


def test_a_node_in_a_group_has_its_parent() -> None:
    inner = "<graph><node id='g::a'/></graph>"
    raw = (
        '<graphml xmlns="http://graphml.graphdrawing.org/xmlns"><graph>'
        f"<node id='g'>{inner}</node></graph></graphml>"
    )
    rig = read_rig(raw.encode())
    assert [element.attributes for element in rig.elements] == [
        {"id": "g"},
        {"id": "g::a", "parent": "g"},
    ]


def test_a_chemputer_link_may_say_how_much_its_tube_holds() -> None:
    nodes = [{"id": "f", "class": "ChemputerFlask"}, {"id": "v", "class": "ChemputerValve"}]
    ends = {"source": "f", "target": "v", "port": "(0,1)"}
    links = [{**ends, "volume": value} for value in (0.25, "1.0", -1.0, None)]
    rig = read_rig(node_link(nodes, links))
    assert [tube.dead_volume_nl for tube in rig.tubes] == [250_000, 1_000_000, None, None]


def test_one_number_on_a_link_is_the_port_of_its_valve() -> None:
    edges = (
        '<edge source="n0" target="n1"/><edge source="n1" target="n2"><data key="p">3</data></edge>'
    )
    words = {"pump": "chemputer_pump", "valve": "chemputer_valve", "flask": "chemputer_flask"}
    rig = read_rig(graphml(edges, type="int", default="<default>-1</default>", **words))
    assert ports_of(rig) == [
        ("n0", "", "valve_1", "-1", True),
        ("valve_1", "3", "n2", "", True),
    ]


@pytest.mark.parametrize("port", [[], ["0", "3"], 3.0, True])
def test_what_names_no_port_is_the_name_of_none(port: object) -> None:
    nodes = [{"id": "f", "class": "ChemputerFlask"}, {"id": "v", "class": "ChemputerValve"}]
    rig = read_rig(node_link(nodes, [{"source": "f", "target": "v", "port": port}]))
    assert ports_of(rig) == [("f", "", "v", "", False)]


@pytest.mark.parametrize("volume", ["1e999999", "1e99999999999999999999", "NaN", "25 mL", True])
def test_what_is_no_volume_is_not_the_size_of_a_syringe(volume: object) -> None:
    node = {"id": "p", "class": "virtual_transfer_pump", "config": {"max_volume": volume}}
    assert read_rig(node_link([node], [])).elements[0].capacity_nl is None


def test_a_common_port_may_be_a_number() -> None:
    node = {"id": "v", "class": "virtual_multiway_valve", "config": {"common_port": 0}}
    assert read_rig(node_link([node], [])).elements[0].common_port == "0"


def test_a_position_that_joins_three_ports_is_never_turned_to() -> None:
    joins = {"all": [["1", "2"], ["2", "3"]], "one": [["1", "2"], ["3", "4"]], "none": [["1", "3"]]}
    node = {"id": "v", "class": "virtual_valve", "config": {"joins": joins}}
    (valve,) = read_rig(node_link([node], [])).elements
    assert [valve.position("1", "2"), valve.position("2", "3"), valve.position("3", "1")] == [
        *("one", None, "none")
    ]


def test_an_id_of_another_type_is_told_as_it_stands() -> None:
    (finding,) = refusal(node_link([{"id": 1.5}], [])).findings
    assert (finding.code, "1.5" in finding.message) == ("lab_file.node_id", True)


@pytest.mark.parametrize(
    ("raw", "code"),
    [
        (b"<?xml version='1.0'?><!DOCTYPE g [<!ENTITY a 'b'>]><g>&a;</g>", "lab_file.doctype"),
        (b"<!DocType g><g/>", "lab_file.doctype"),
        ("<!DOCTYPE g><g/>".encode("utf-16"), "lab_file.encoding"),
        ("<!DOCTYPE g><g/>".encode("utf-16-le"), "lab_file.doctype"),
        (b"<g>", "lab_file.xml"),
        (b"<g>&undeclared;</g>", "lab_file.xml"),
        (b"<g/>", "lab_file.no_nodes"),
        (b"<a>" * 5000, "lab_file.depth"),
        (b"{}", "lab_file.no_nodes"),
        (b'{"nodes": 3}', "lab_file.no_nodes"),
        (b'{"nodes": [], "links": 3}', "lab_file.shape"),
        (b'{"nodes": [], "nodes": []}', "lab_file.duplicate_key"),
        (b"", "lab_file.json"),
    ],
)
def test_a_hostile_file_is_refused(raw: bytes, code: str) -> None:
    assert refusal(raw).code == code


def test_broken_xml_is_told_with_its_line() -> None:
    assert "line 2" in refusal(b"<g>\n<a></b></g>").message


def test_the_starter_lab_is_a_rig_and_is_given_back_as_it_stands() -> None:
    raw = (ROOT / "fixtures/labs/starter/lab.json").read_bytes()
    rig = read_rig(raw)
    assert {ElementRole.PUMP, ElementRole.VALVE, ElementRole.VESSEL} <= {
        element.role for element in rig.elements
    }
    assert write_rig(rig) == raw
    with pytest.raises(LabFileError) as caught:
        write_rig(rig, RigFormat.GRAPHML)
    assert caught.value.code == "lab_file.format"


KEYS = st.text("ab", min_size=1)
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**62), 2**62)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=2),
    max_leaves=4,
)  # fmt: skip
FIELDS = st.fixed_dictionaries(
    {},
    optional=dict.fromkeys(("chemical", "x", "current_volume", "label"), VALUES)
    | {"config": st.none() | st.dictionaries(KEYS, VALUES, max_size=2)},
)


@settings(max_examples=150, deadline=None)
@given(fields=st.lists(FIELDS, min_size=1, max_size=3), top=VALUES)
def test_a_node_link_graph_survives_graphml(fields: list[dict[str, Any]], top: object) -> None:
    nodes = [{**each, "id": f"n {place}"} for place, each in enumerate(fields)]
    links = [{**fields[0], "source": "n 0", "target": "n 0"}]
    rig = read_rig(node_link(nodes, links, graph=top))
    again = read_rig(write_rig(rig, RigFormat.GRAPHML))
    assert json.loads(write_rig(again, RigFormat.NODE_LINK)) == json.loads(write_rig(rig))


@pytest.mark.parametrize("node", [{"id": "a\x01"}, {"id": "a\ufffe"}, {"id": "a", "b\x02": 1}])
def test_a_character_that_xml_cannot_hold_is_refused_and_not_written(node: dict[str, Any]) -> None:
    rig = read_rig(node_link([node], []))
    with pytest.raises(LabFileError) as caught:
        write_rig(rig, RigFormat.GRAPHML)
    assert caught.value.findings[0].code == "lab_file.text"
    assert read_rig(write_rig(rig)).elements == rig.elements


def published() -> list[Path]:
    found = [*GRAPHS.rglob("*.json"), *XDL.rglob("*.json"), *XDL.rglob("*.graphml*")]
    return sorted(path for path in found if "oracle" not in path.name)


@pytest.mark.skipif(not XDL.is_dir(), reason=NO_XDL)
def test_every_published_graph_is_written_without_a_loss() -> None:
    count = 0
    for path in published():
        raw = path.read_bytes()
        raw = gzip.decompress(raw) if path.suffix == ".gz" else raw
        try:
            rig = read_rig(raw)
        except LabFileError as error:
            codes = {finding.code for finding in error.findings}
            assert codes <= {"graph.duplicate_id", "lab_file.no_nodes"}, path
            continue
        count += 1
        if rig.format is RigFormat.NODE_LINK and path.stat().st_size < 200_000:
            assert json.loads(write_rig(rig)) == json.loads(raw), path
            again = read_rig(write_rig(rig, RigFormat.GRAPHML))
            assert [e.attributes for e in again.elements] == [e.attributes for e in rig.elements]
            assert ports_of(again) == ports_of(rig), path
        elif rig.format is RigFormat.GRAPHML:
            assert write_rig(rig) == raw, path
            assert ports_of(read_rig(write_rig(rig, RigFormat.NODE_LINK))) == ports_of(rig), path
    assert count == 186


def test_a_syringe_of_a_drive_that_only_infuses_pumps_for_no_recipe() -> None:
    lab = json.loads((ROOT / "fixtures/labs/starter/lab.json").read_bytes())
    both = {"pump_1", "pump_2"}
    pumps = {one.key for one in read_rig(json.dumps(lab).encode()).elements if one.key in both}
    lab["devices"][0]["nodes"] = {"infusion_pump": "pump_1"}
    roles = {one.key: one.role for one in read_rig(json.dumps(lab).encode()).elements}
    assert pumps == both
    assert (roles["pump_1"], roles["pump_2"]) == (ElementRole.OTHER, ElementRole.PUMP)
