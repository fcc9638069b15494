from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.errors import LabFileError
from labweb.domain.graph.lab_file.bind import apply_binding
from labweb.domain.graph.lab_file.bindings import read_binding
from labweb.domain.graph.lab_file.model import LabFile
from labweb.domain.graph.lab_file.uni_lab_os.export import export_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.reader import read_uni_lab_os

RAW = (Path(__file__).parents[4] / "fixtures/bindings/uni_lab_os.json").read_bytes()
BINDING = read_binding(RAW)
Value = dict[str, Any]


def node(key: str, sort: str, **config: object) -> Value:
    return {"id": key, "parent": "station", "type": "device", "class": sort, "config": config}


def station() -> Value:
    """flask ──1── valve ──transferpump── pump,  heater and stirrer at flask"""
    links = [
        ("pump", "transferpump", "valve", "transferpump", "fluid"),
        ("valve", "1", "flask", "top", "fluid"),
        ("heater", "plate", "flask", "bind", "thermal"),
        ("stirrer", "plate", "flask", "bind", "mechanical"),
    ]
    return {
        "nodes": [
            {"id": "station", "type": "device", "class": "workstation"},
            node("pump", "virtual_transfer_pump", max_volume=12.5, address=3),
            node("valve", "virtual_multiway_valve", positions=8),
            node("heater", "virtual_heatchill", max_temp=120.0),
            node("stirrer", "virtual_stirrer", max_speed=900.0),
            {"id": "flask", "parent": "station", "type": "container", "config": {"max_volume": 50}},
        ],
        "links": [
            {"source": a, "target": b, "type": sort, "port": {a: at_a, b: at_b}}
            for a, at_a, b, at_b, sort in links
        ],
    }


def bind(value: Value) -> tuple[LabFile, list[str]]:
    lab, notes = apply_binding(read_uni_lab_os(json.dumps(value).encode(), "Station"), BINDING)
    assert export_uni_lab_os(lab) == value
    return lab, [note.message for note in notes]


def test_pump_and_valve_become_one_device_and_heater_and_stirrer_another() -> None:
    lab, notes = bind(station())
    assert notes == []
    pump, plate = lab.devices
    assert pump.config == {"syringe_ul": 12_500, "ports_count": 8, "address": "3"}
    keys = {role: lab.tree.by_id[found].key for role, found in pump.nodes.items()}
    assert keys == {"pump": "pump", "valve": "valve"}
    assert set(plate.nodes) == {"heater", "stirrer"}
    assert plate.config == {"max_temperature_c": 120.0}
    assert lab.tree.by_key["pump"].config == {"capacity_ul": 12_500}
    assert lab.tree.by_key["valve"].config == {"ports_count": 8, "common_port": "transferpump"}
    assert lab.tree.by_key["stirrer"].config == {"max_speed_rpm": 900.0}


@pytest.mark.parametrize(
    ("index", "config", "reason"),
    [
        (1, {}, "pump has no config.max_volume"),
        (1, {"max_volume": "25 mL"}, "no positive number"),
        (1, {"max_volume": 25, "address": []}, "not text"),
        (2, {}, "valve has no config.positions"),
        (2, {"positions": 8.5}, "not whole"),
    ],
)
def test_a_pump_that_lacks_something_stays_unbound_with_a_note(
    index: int, config: Value, reason: str
) -> None:
    value = station()
    value["nodes"][index]["config"] = config
    lab, notes = bind(value)
    assert [device.key for device in lab.devices] == ["heater"]
    assert any(reason in note for note in notes)


@pytest.mark.parametrize(
    ("link", "changes", "reason"),
    [
        (0, {"type": "physical"}, "no valve joined to it"),
        (0, {"port": {"pump": "a", "valve": "8"}}, "no valve joined to it"),
        (1, {"port": {"valve": "inlet", "flask": "top"}}, "neither 'transferpump' nor a number"),
        (1, {"port": {"valve": "9", "flask": "top"}}, "a number from 1 to 8"),
    ],
)
def test_a_pump_that_is_not_joined_as_the_rule_says_stays_unbound(
    link: int, changes: Value, reason: str
) -> None:
    value = station()
    value["links"][link] |= changes
    lab, notes = bind(value)
    assert "pump" not in [device.key for device in lab.devices]
    assert any(reason in note for note in notes)


def test_two_pumps_on_one_valve_are_not_chosen_between() -> None:
    value = station()
    value["nodes"].append(node("other", "virtual_transfer_pump", max_volume=5))
    value["links"].append(value["links"][0] | {"source": "other", "port": {"other": "a"}})
    value["links"][-1]["port"]["valve"] = "transferpump"
    lab, notes = bind(value)
    assert [device.key for device in lab.devices] == ["heater"]
    assert any("several nodes as pump share it" in note for note in notes)


def test_an_unmapped_class_is_listed() -> None:
    value = station()
    value["nodes"].append(node("oven", "oven.acme"))
    lab, notes = bind(value)
    assert notes == ["oven: class 'oven.acme' is mapped to no kind"]
    assert lab.tree.by_key["oven"].kind == "foreign"


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("classes", "container", "kind"), "jar"),
        (("devices", 0, "selector", "role"), "gate"),
        (("devices", 0, "join"), None),
        (("devices", 0, "selector", "count", "form"), "any"),
        (("devices", 0, "colour"), "blue"),
        (("schema",), "labweb.binding/9"),
    ],
)
def test_a_binding_that_makes_no_sense_is_refused(path: tuple[Any, ...], value: object) -> None:
    binding: Any = json.loads(RAW)
    holder = binding
    for part in path[:-1]:
        holder = holder[part]
    holder[path[-1]] = value
    with pytest.raises(LabFileError) as caught:
        read_binding(json.dumps(binding).encode())
    assert caught.value.findings
