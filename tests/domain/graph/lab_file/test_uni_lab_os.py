from __future__ import annotations

import copy
import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.errors import LabFileError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.lab_file.uni_lab_os.graph_read import read_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.graph_write import export_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.nodes_and_links import parse_ports
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.resources.contents_by_lot import LotId


def read(value: object) -> LabFile:
    return read_uni_lab_os(json.dumps(value).encode(), "Imported")


def graph(*nodes: dict[str, Any], links: list[dict[str, Any]] | None = None) -> dict[str, Any]:
    return {"nodes": list(nodes), "links": links or []}


def flask(**fields: object) -> dict[str, Any]:
    return {"id": "flask", "type": "container", "class": None, "parent": None, **fields}


def holding(lab: LabFile, key: str) -> dict[str, int]:
    contents = lab.contents.get(lab.tree.by_key[key].id, {})
    return {
        lab.materials_by_id[lab.lots_by_id[lot].material_id].key: amount
        for lot, amount in contents.items()
    }


@pytest.mark.parametrize(
    "said",
    [
        {"data": {"liquid": [{"liquid_type": "DMF", "liquid_volume": 1.5}]}},
        {"data": {"liquid": [{"name": "DMF", "volume": 1.5, "concentration": "99 %"}]}},
        {"data": {"liquids": [["DMF", 1.5]], "pending_liquids": [["DMF", 1.5]]}},
        {"data": {"liquid_type": "DMF", "liquid_volume": 1.5}},
        {"chemical": "DMF", "current_volume": 1.5, "max_volume": 10},
    ],
)
def test_each_shape_of_liquid_is_read_in_millilitres(said: dict[str, Any]) -> None:
    value = graph(flask(**{"config": {"max_volume": 10}, **said}))
    lab = read(value)
    assert holding(lab, "flask") == {"DMF": 1_500_000}
    assert lab.tree.by_key["flask"].config == {"capacity_ul": 10_000}
    assert [material.density_mg_ul for material in lab.materials] == [None]
    assert export_uni_lab_os(lab) == value


def test_a_pylabrobot_well_counts_in_microlitres_and_has_a_pose_in_millimetres() -> None:
    rotation = {"x": 0, "y": 0, "z": 90, "type": "Rotation"}
    config = {"type": "Well", "category": "well", "rotation": rotation, "max_volume": 360}
    config |= {"size_x": 6.8, "size_y": 6.8, "size_z": 10.6}
    value = graph(
        flask(
            **{"class": "", "type": "device", "config": config},
            position={"x": 1, "y": 2.5, "z": 3},
            data={"liquids": [["water", 50.0]]},
        )
    )
    lab = read(value)
    well = lab.resources[0]
    assert (well.kind, well.config["capacity_ul"]) == ("well", 360)
    assert holding(lab, "flask") == {"water": 50_000}
    assert well.pose is not None
    assert (well.pose.x_mm, well.pose.y_mm) == (1.0, 2.5)
    assert well.pose.rotation_wxyz == pytest.approx((0.5**0.5, 0, 0, 0.5**0.5))
    assert well.size_mm == (6.8, 6.8, 10.6)
    assert export_uni_lab_os(lab) == value


def test_a_position_on_a_drawing_is_no_pose() -> None:
    lab = read(graph(flask(position={"x": 620.6, "y": 171, "z": 0})))
    assert lab.resources[0].pose is None


@pytest.mark.parametrize(
    ("data", "code"),
    [
        ({"liquid": [{"liquid_type": "DMF", "liquid_volume": "100"}]}, "amount_unread"),
        ({"liquid": [{"liquid_type": "DMF", "liquid_volume": 1e-9}]}, "off_grid"),
        ({"liquid": [{"liquid_type": "DMF", "liquid_volume": -1}]}, "off_grid"),
        ({"liquid": [{"liquid_type": "DMF", "liquid_volume": 11}]}, "overfull"),
        ({"liquid": [{"name": "DMF", "volume": 1}], "liquids": [["DMF", 2]]}, "liquids_differ"),
        ({"reagent_name": "NaCl", "current_mass": 5.0}, "mass"),
    ],
)
def test_an_amount_that_cannot_be_taken_is_noted_and_kept(data: dict[str, Any], code: str) -> None:
    value = graph(flask(config={"max_volume": 10}, data=data))
    lab = read(value)
    assert [note.code for note in lab.notes] == [f"uni_lab_os.{code}"]
    assert lab.contents == {}
    assert export_uni_lab_os(lab) == value


@pytest.mark.parametrize(
    ("link", "ports"),
    [
        ({"source": "a", "target": "b", "port": {"a": "1", "b": "top"}}, ("1", "top")),
        ({"source": "a", "target": "b", "port": {"a": 1}}, ("1", "")),
        ({"source": "a", "target": "b", "port": "(-1, 0)"}, ("-1", "0")),
        ({"source": "a", "target": "b", "port": "(,)"}, ("", "")),
        ({"source": "a", "target": "b", "port": "3"}, ("3", "")),
        ({"source": "a", "target": "b", "port": 3}, ("3", "")),
        ({"source": "a", "target": "b", "port": {}}, ("", "")),
        ({"source": "a", "target": "b", "sourceHandle": "x", "targetHandle": "y"}, ("x", "y")),
        ({"source": "a", "target": "b"}, ("", "")),
    ],
)
def test_each_way_of_naming_ports_is_understood(
    link: dict[str, Any], ports: tuple[str, str]
) -> None:
    assert parse_ports(link) == ports
    value = graph(flask(), {"id": "a", "parent": "flask"}, {"id": "b", "parent": "flask"})
    value["links"] = [link]
    assert export_uni_lab_os(read(value)) == value


def test_a_fluid_link_is_a_two_way_tube_that_keeps_its_direction() -> None:
    """flask ──fluid──▶ pump, and once more beside it"""
    link = {"source": "flask", "target": "pump", "type": "fluid", "port": "(1,2)"}
    value = graph(flask(), {"id": "pump", "parent": "flask"}, links=[link, dict(link), {**link}])
    value["links"][2] |= {"source": "pump", "target": "flask", "type": "physical"}
    lab = read(value)
    assert [tube.medium for tube in lab.connections] == [Medium.LIQUID] * 2 + [Medium.OTHER]
    first = lab.connections[0]
    assert first.is_two_way
    assert first.dead_volume_nl is None
    assert (first.source.port, first.target.port) == ("1", "2")
    assert export_uni_lab_os(lab)["links"] == value["links"]


def test_an_unmapped_class_is_kept_whole_as_foreign() -> None:
    node = {"id": 5, "class": "hplc.agilent", "type": "device", "config": {"NaN": "x"}, "z": [1]}
    lab = read(graph(node))
    assert (lab.resources[0].kind, lab.resources[0].key) == ("foreign", "5")
    assert lab.resources[0].config == {"NaN": "x"}
    assert [note.code for note in lab.notes] == ["uni_lab_os.foreign"]
    assert export_uni_lab_os(lab) == graph(node)


def test_children_lists_alone_make_a_tree() -> None:
    value = graph(flask(children=["a"]), {"id": "a", "children": ["b"]}, {"id": "b"})
    lab = read(value)
    assert [r.key for r in lab.tree.ancestors(lab.tree.by_key["b"].id)] == ["a", "flask"]
    assert export_uni_lab_os(lab) == value


def test_parents_may_be_given_by_uuid() -> None:
    value = graph(flask(uuid="u-1"), {"id": "a", "parent_uuid": "u-1"})
    assert read(value).tree.by_key["a"].parent_id == read(value).tree.by_key["flask"].id
    assert export_uni_lab_os(read(value)) == value


def test_several_roots_get_one_above_them_that_export_leaves_out() -> None:
    value = {"nodes": [flask(), flask(id="lab")], "edges": [], "directed": False}
    lab = read(value)
    assert [resource.key for resource in lab.resources] == ["lab_2", "flask", "lab"]
    assert lab.resources[0].kind == "lab"
    assert export_uni_lab_os(lab) == value


def test_every_defect_of_a_graph_is_listed_and_nothing_is_imported() -> None:
    value = graph(
        flask(children=["a", ["ghost"]]),
        {"id": "a", "parent": "b"},
        {"id": "b", "parent": "a"},
        {"id": "c", "parent": "nowhere"},
        {"id": "c"},
        {"name": "no id"},
        links=[
            {"id": 1, "source": "flask", "target": "?"},
            {"id": 1, "source": "a", "target": "b"},
        ],
    )
    with pytest.raises(LabFileError) as caught:
        read(value)
    assert sorted(finding.code for finding in caught.value.findings) == [
        "lab_file.dangling_end",
        "lab_file.duplicate",
        "lab_file.node_id",
        "tree.cycle",
        "tree.dangling_child",
        "tree.dangling_parent",
        "tree.duplicate",
        "tree.two_parents",
    ]


def test_a_child_that_is_made_at_run_time_is_no_defect_and_is_noted() -> None:
    value = graph(flask(children=["deck"]), {"id": "a", "parent": "flask"})
    lab = read(value)
    assert export_uni_lab_os(lab) == value
    (note,) = [note for note in lab.notes if note.code == "uni_lab_os.made_later"]
    assert (note.subject, "'deck'" in note.message) == ("flask", True)


def test_a_parent_that_is_made_at_run_time_is_the_node_that_lists_the_child() -> None:
    value = graph(flask(children=["deck"]), {"id": "deck", "parent": "lh_deck"})
    lab = read(value)
    assert lab.tree.by_key["deck"].parent_id == lab.tree.by_key["flask"].id
    assert export_uni_lab_os(lab) == value


def test_a_file_with_two_lists_of_links_is_refused() -> None:
    link = {"source": "flask", "target": "flask"}
    with pytest.raises(LabFileError) as caught:
        read({"nodes": [flask()], "links": [link], "edges": [link]})
    assert caught.value.code == "lab_file.links_twice"


def test_what_changed_since_the_import_is_exported_as_it_is() -> None:
    value = graph(
        flask(children=["a", "b"], config={"max_volume": 10}, data={"liquids": [["DMF", 2.0]]}),
        {"id": "a", "name": "A", "parent": "flask", "children": []},
        {"id": "b", "name": "B", "parent": "flask", "children": []},
    )
    lab = read(value)
    first, a, b = lab.resources
    lot = LotId(str(lab.lots[0].id))
    changed = replace(
        lab,
        resources=(first, replace(a, name="Renamed"), replace(b, parent_id=a.id)),
        contents={first.id: {lot: 500_000}},
    )
    nodes = export_uni_lab_os(changed)["nodes"]
    assert nodes[0]["children"] == ["a"]
    assert nodes[0]["data"] == {"liquid": [{"liquid_type": "DMF", "liquid_volume": 0.5}]}
    assert (nodes[1]["name"], nodes[1]["children"], nodes[2]["parent"]) == ("Renamed", ["b"], "a")
    assert holding(read(export_uni_lab_os(changed)), "flask") == {"DMF": 500_000}


JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-1000, 1000) | st.text(st.characters(codec="ascii")),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text("abcxyz"), inner, max_size=3)
    ),
    max_leaves=6,
).filter(lambda value: "\\u0000" not in json.dumps(value))
NODES = st.lists(
    st.fixed_dictionaries(
        {"parent": st.integers(-1, 5), "class": st.sampled_from([None, "", "container", "x"])},
        optional={
            "type": st.sampled_from(["container", "device", "plate", "well"]),
            "name": st.text("né ", max_size=4),
            "config": st.dictionaries(st.sampled_from(["max_volume", "port"]), JSON, max_size=2),
            "data": st.dictionaries(st.sampled_from(["liquid", "liquids", "x"]), JSON, max_size=2),
            "pose": JSON,
            "extra": st.dictionaries(st.text("ab"), JSON, max_size=2),
        },
    ),
    min_size=1,
    max_size=6,
)
LINKS = st.lists(
    st.fixed_dictionaries(
        {"source": st.integers(0, 5), "target": st.integers(0, 5)},
        optional={"type": st.sampled_from(["fluid", "physical", None]), "port": JSON, "w": JSON},
    ),
    max_size=6,
)


@given(NODES, LINKS)
@settings(max_examples=50)
def test_any_sound_graph_comes_back_deep_equal(
    nodes: list[dict[str, Any]], links: list[dict[str, Any]]
) -> None:
    value = {"nodes": copy.deepcopy(nodes), "links": copy.deepcopy(links)}
    for index, node in enumerate(value["nodes"]):
        # A parent always comes earlier in the file, so there is no ring.
        node |= {"id": f"n{index}", "parent": f"n{node['parent'] % index}" if index else None}
    for link in value["links"]:
        for end in ("source", "target"):
            link[end] = f"n{link[end] % len(nodes)}"
    lab = read(value)
    assert export_uni_lab_os(lab) == value
    assert export_uni_lab_os(read_lab(render_lab(lab))) == value
