from __future__ import annotations

import copy
import json
import random
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.errors import Finding, LabFileError
from labweb.domain.graph.lab_file import lab_json_schema as schema_module
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_json_schema import lab_schema
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.lab_file.simulated_bench import bench_for, bench_notes, endpoints_needed
from labweb.domain.resources.exact_volumes import MAX_NL, from_nl, to_nl
from tests.labs import generated_lab

ROOT = Path(__file__).parents[4]
STARTER = (ROOT / "fixtures/labs/starter/lab.json").read_bytes()
Change = tuple[str, str, str, object]


def starter() -> dict[str, Any]:
    value: dict[str, Any] = json.loads(STARTER)
    return value


def entry(lab: dict[str, Any], sort: str, key: str) -> dict[str, Any]:
    return next(found for found in lab[sort] if found["key"] == key)


def findings_of(lab: dict[str, Any]) -> list[Finding]:
    with pytest.raises(LabFileError) as caught:
        read_lab(json.dumps(lab).encode())
    return list(caught.value.findings)


def test_the_starter_lab_is_read_and_written_back_equal() -> None:
    lab = read_lab(STARTER)
    assert read_lab(render_lab(lab)) == lab
    assert len(lab.devices) == 6
    assert {device.simulator is None for device in lab.devices} == {False}


def test_ids_depend_on_the_lab_and_the_key_alone() -> None:
    once, again = read_lab(STARTER), read_lab(STARTER)
    other = starter() | {"name": "Another lab"}
    assert [r.id for r in once.resources] == [r.id for r in again.resources]
    moved = read_lab(json.dumps(other).encode())
    assert not {r.id for r in once.resources} & {r.id for r in moved.resources}


def test_contents_are_whole_nanolitres_by_lot() -> None:
    lab = read_lab(STARTER)
    water = lab.tree.by_key["water"]
    assert list(lab.contents[water.id].values()) == [400_000_000]


@pytest.mark.parametrize(
    ("change", "code", "field"),
    [
        (("resources", "water", "config", {"capacity_ml": 5}), "unknown_field", "capacity_ml"),
        (("resources", "water", "config", {"capacity_ul": -5}), "field", "capacity_ul"),
        (("resources", "water", "config", {"capacity_ul": "500 mL"}), "field", "capacity_ul"),
        (("resources", "water", "config", {"capacity_ul": True}), "field", "capacity_ul"),
        (("resources", "valve_1", "config", {"capacity_ul": 5}), "unknown_field", "capacity_ul"),
        (("resources", "water", "kind", "jar"), "unknown_kind", "kind"),
        (("resources", "water", "parent", "nowhere"), "dangling", "parent"),
        (("resources", "water", "colour", "blue"), "unknown_field", "colour"),
        (("resources", "water", "size_mm", [1, 2]), "field", "size_mm"),
        (("resources", "water", "contents", [{"lot": "?", "amount_ul": 1}]), "dangling", "lot"),
        (
            ("resources", "water", "contents", [{"lot": "water_lot", "amount_ul": 0.0001}]),
            "off_grid",
            "amount_ul",
        ),
        (
            ("resources", "water", "contents", [{"lot": "water_lot", "amount_ul": 600_000}]),
            "overfull",
            "contents",
        ),
        (
            ("resources", "valve_1", "contents", [{"lot": "water_lot", "amount_ul": 1}]),
            "no_vessel",
            "contents",
        ),
        (("connections", "valve_1_1_water", "medium", "soup"), "field", "medium"),
        (("connections", "valve_1_1_water", "dead_volume_ul", -1), "field", "dead_volume_ul"),
        (
            ("connections", "valve_1_1_water", "target", {"resource": "?", "port": "a"}),
            "dangling",
            "target",
        ),
        (("materials", "water", "inchikey", "water"), "field", "inchikey"),
        (("materials", "water", "density_mg_ul", 0), "field", "density_mg_ul"),
        (("lots", "water_lot", "expires_on", "2026-02-31"), "field", "expires_on"),
        (("lots", "water_lot", "material", "wine"), "dangling", "material"),
        (("devices", "pump_1", "driver", "os.system"), "field", "driver"),
        (("devices", "pump_1", "host", "?"), "dangling", "host"),
        (("devices", "pump_1", "nodes", {"pump": "?"}), "dangling", "nodes.pump"),
        (("devices", "pump_1", "nodes", {"pump": "pump_2"}), "node_shared", "nodes"),
        (("devices", "pump_1", "transport", "serial:///dev/ttyUSB0"), "carrier", "transport"),
        (("devices", "pump_1", "simulator", None), "carrier", "transport"),
    ],
)
def test_a_wrong_field_is_refused_by_entry_and_field(change: Change, code: str, field: str) -> None:
    sort, key, name, value = change
    lab = starter()
    entry(lab, sort, key)[name] = value
    found = [(finding.code, finding.context.get("field")) for finding in findings_of(lab)]
    assert (f"lab_file.{code}", field) in found


def test_every_finding_is_listed_not_only_the_first() -> None:
    lab = starter()
    entry(lab, "resources", "water")["config"] = {"capacity_ml": 1, "tare_mg": -1}
    entry(lab, "lots", "dye_lot")["material"] = "wine"
    entry(lab, "devices", "pump_1")["transport"] = "serial:///dev/ttyUSB0"
    lab["connections"][0]["medium"] = "soup"
    found = findings_of(lab)
    assert [finding.code for finding in found] == [
        "lab_file.dangling",
        "lab_file.field",
        "lab_file.unknown_field",
        "lab_file.field",
        "lab_file.carrier",
    ]


@pytest.mark.parametrize(
    ("rotation", "is_read"),
    [([1, 0, 0, 0], True), ([0, 0, 0, 0], False), ([1, 0, 0], False), ("1000", False)],
)
def test_a_pose_that_is_no_rotation_is_refused(rotation: object, *, is_read: bool) -> None:
    lab = starter()
    entry(lab, "resources", "water")["pose"] = {
        "x_mm": 1,
        "y_mm": 2,
        "z_mm": 3,
        "rotation_wxyz": rotation,
    }
    if is_read:
        pose = read_lab(json.dumps(lab).encode()).tree.by_key["water"].pose
        assert pose is not None
        assert pose.x_mm == 1
    else:
        assert any("pose" in finding.message for finding in findings_of(lab))


def test_parents_in_a_ring_and_two_roots_are_refused() -> None:
    lab = starter()
    entry(lab, "resources", "bench_1")["parent"] = "water"
    assert {finding.code for finding in findings_of(lab)} == {"tree.cycle"}
    lab = starter()
    entry(lab, "resources", "bench_1")["parent"] = None
    assert [finding.code for finding in findings_of(lab)] == ["lab_file.root"]


def test_two_tubes_at_one_port_of_a_driven_valve_are_refused() -> None:
    lab = starter()
    entry(lab, "connections", "valve_1_2_acid")["source"]["port"] = "1"
    assert [finding.code for finding in findings_of(lab)] == ["lab_file.port_taken"]


def test_devices_on_one_line_need_addresses_of_their_own() -> None:
    lab = starter()
    for key in ("pump_1", "pump_2"):
        entry(lab, "devices", key)["simulator"]["line"] = "rs485"
    assert [finding.code for finding in findings_of(lab)] == ["lab_file.line_address"]
    entry(lab, "devices", "pump_2")["config"]["address"] = "2"
    assert endpoints_needed(read_lab(json.dumps(lab).encode()))[0] == ("rs485", "pty")


def test_a_live_lab_has_a_transport_for_every_device() -> None:
    lab = starter() | {"mode": "live"}
    assert len([f for f in findings_of(lab) if f.code == "lab_file.carrier"]) == 6
    for device in lab["devices"]:
        device |= {"transport": f"serial:///dev/{device['key']}?baud=9600", "simulator": None}
    read = read_lab(json.dumps(lab).encode())
    assert read.devices[0].transport == "serial:///dev/pump_1?baud=9600"
    assert read_lab(render_lab(read)) == read


def test_the_shipped_schema_is_the_one_that_the_code_means() -> None:
    path = Path(str(schema_module.__file__)).with_name("lab.schema.json")
    shipped = json.loads(path.read_text(encoding="utf-8"))
    assert shipped == json.loads(json.dumps(lab_schema()))
    jsonschema.Draft202012Validator.check_schema(lab_schema())


def test_the_schema_takes_the_starter_and_refuses_a_wrong_unit() -> None:
    validator = jsonschema.Draft202012Validator(lab_schema())
    validator.validate(json.loads(STARTER))
    lab = starter()
    entry(lab, "resources", "water")["config"] = {"capacity_ml": 500}
    assert not validator.is_valid(lab)


@given(st.integers(0, 10**9))
@settings(max_examples=40)
def test_generated_labs_are_valid_and_written_back_equal(seed: int) -> None:
    raw = generated_lab(seed)
    lab = read_lab(raw)
    assert read_lab(render_lab(lab)) == lab
    bench = bench_for(lab, dict(endpoints_needed(lab)))
    pumps = [device for device in lab.devices if "pump" in device.nodes]
    assert [instrument["id"] for instrument in bench["instruments"]] == [d.key for d in pumps]
    attached = [
        port["vessel"]
        for instrument in bench["instruments"]
        for port in instrument["attached"]["ports"].values()
        if "vessel" in port
    ]
    assert set(attached) == {vessel["id"] for vessel in bench["vessels"]}
    assert bench_notes(lab, dict(endpoints_needed(lab))).unattached == ()


def test_the_same_seed_gives_the_same_lab_and_another_seed_another() -> None:
    assert generated_lab(7) == generated_lab(7)
    assert len({generated_lab(seed) for seed in range(50)}) == 50


@given(st.integers(0, MAX_NL))
def test_every_amount_survives_a_file(amount_nl: int) -> None:
    for unit in (1_000, 1_000_000):
        written = json.loads(json.dumps(from_nl(amount_nl, unit)))
        assert to_nl(written, unit) == amount_nl


WRONG: tuple[object, ...] = (
    *(None, True, 0, -1, 1e300, 0.0001, "", "x", "x" * 600, "water"),
    *([], {}, [None], {"a": 1}),
)


@given(st.randoms(use_true_random=False))
@settings(max_examples=80)
def test_a_damaged_file_is_read_whole_or_refused_with_findings(rnd: random.Random) -> None:
    raw = json.dumps(damaged(starter(), rnd)).encode()
    findings: tuple[Finding, ...] = ()
    read = None
    try:
        read = read_lab(raw)
    except LabFileError as error:
        findings = error.findings
    if read is None:
        assert findings
    else:
        assert read_lab(render_lab(read)) == read


def damaged(lab: dict[str, Any], rnd: random.Random) -> dict[str, Any]:
    """Change one to three places of a lab file, at any depth."""
    lab = copy.deepcopy(lab)
    for _ in range(rnd.randint(1, 3)):
        holder: Any = lab
        key = rnd.choice(list(lab))
        while isinstance(holder[key], dict | list) and holder[key] and rnd.random() < 0.8:
            holder = holder[key]
            key = rnd.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
        if rnd.random() < 0.3 and len(lab) > 1:
            del holder[key]
        else:
            holder[key] = copy.deepcopy(rnd.choice(WRONG))
    return lab


def codes_of(value: dict[str, Any]) -> set[tuple[str, str]]:
    with pytest.raises(LabFileError) as caught:
        read_lab(json.dumps(value).encode())
    return {(finding.code, finding.subject) for finding in caught.value.findings}


@pytest.mark.parametrize("character", ["\n", "\x1b", "\x7f", "\x85", "\u202e", "\u2066", "\u2069"])
@pytest.mark.parametrize("sort", ["resources", "materials", "devices", "hosts"])
def test_a_name_that_controls_how_text_is_shown_is_refused(sort: str, character: str) -> None:
    value = starter()
    entry = value[sort][-1]
    entry["name"] = f"a{character}b"
    assert codes_of(value) == {("lab_file.name", entry["key"])}
    entry["name"] = "مختبر א 实验室 µ"
    read_lab(json.dumps(value).encode())


@pytest.mark.parametrize("axis", ["x_mm", "y_mm", "z_mm"])
def test_a_place_more_than_a_kilometre_away_is_refused(axis: str) -> None:
    value = starter()
    entry = next(entry for entry in value["resources"] if entry.get("pose"))
    entry["pose"][axis] = -1e6
    read_lab(json.dumps(value).encode())
    entry["pose"][axis] = -1_000_001
    assert codes_of(value) == {("pose.too_far", entry["key"])}


@pytest.mark.parametrize("order", [1, -1])
def test_a_tree_without_end_is_refused(order: int) -> None:
    value = starter()
    root = next(entry["key"] for entry in value["resources"] if entry.get("parent") is None)

    def chained(count: int) -> dict[str, Any]:
        chain = [
            {
                **{"key": f"n{place}", "name": f"N{place}", "kind": "deck"},
                "parent": root if place == 0 else f"n{place - 1}",
            }
            for place in range(count)
        ]
        return value | {"resources": value["resources"] + chain[::order]}

    read_lab(json.dumps(chained(99)).encode())
    (found,) = codes_of(chained(100))
    assert found[0] == "tree.too_deep"
    assert codes_of(chained(20_000))
