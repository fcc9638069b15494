from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.errors import LabFileError
from labweb.domain.graph.lab_file.apply_binding import apply_binding
from labweb.domain.graph.lab_file.binding_file import BindingFile, read_binding
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.lab_file.simulated_bench import bench_for, endpoints_needed
from labweb.domain.graph.lab_file.uni_lab_os.graph_read import read_uni_lab_os
from labweb.domain.graph.lab_file.uni_lab_os.graph_write import export_uni_lab_os
from labweb.domain.graph.ports_and_connections import Medium

RAW = (Path(__file__).parents[4] / "fixtures/bindings/uni_lab_os.json").read_bytes()
BINDING = read_binding(RAW)
Value = dict[str, Any]


def node(key: str, sort: str, **config: object) -> Value:
    return {"id": key, "parent": "station", "type": "device", "class": sort, "config": config}


def station() -> Value:
    """flask ──1── valve ──transferpump── pump,  thermostat and stirrer at flask"""
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


def bind(value: Value, binding: BindingFile = BINDING) -> tuple[LabFile, list[str]]:
    lab, notes = apply_binding(read_uni_lab_os(json.dumps(value).encode(), "Station"), binding)
    assert export_uni_lab_os(lab) == value
    return lab, [note.message for note in notes]


def drivers(lab: LabFile) -> dict[str, str]:
    return {device.key: device.driver.rpartition(":")[2] for device in lab.devices}


def nodes(lab: LabFile, key: str) -> dict[str, str]:
    device = next(device for device in lab.devices if device.key == key)
    return {role: lab.tree.by_id[found].key for role, found in device.nodes.items()}


INSTRUMENTS = {"pump": "TricontinentC3000", "heater": "HuberPb", "stirrer": "IkaMicrostar75"}
TIMERS = {"timer_1": "HostTimer", "timer_2": "HostTimer"}


def test_pump_and_valve_become_one_device_and_thermostat_and_stirrer_one_each() -> None:
    lab, notes = bind(station())
    assert notes == []
    assert drivers(lab) == INSTRUMENTS | TIMERS
    pump, heater, _, *_ = lab.devices
    assert pump.config == {"syringe_ul": 12_500, "ports_count": 8, "address": "3"}
    assert nodes(lab, "pump") == {"pump": "pump", "valve": "valve"}
    assert nodes(lab, "heater") == {"thermostat": "heater"}
    assert heater.simulator is not None
    assert heater.simulator.settings == {"low_c": -40.0, "high_c": 120.0}
    assert lab.tree.by_key["pump"].config == {"capacity_ul": 12_500}
    assert lab.tree.by_key["valve"].config == {"ports_count": 8, "common_port": "transferpump"}
    assert lab.tree.by_key["heater"].config == {"max_temperature_c": 120.0}
    assert lab.tree.by_key["stirrer"].config == {"max_speed_rpm": 900.0}


def test_the_timers_of_the_host_have_keys_of_their_own_and_no_node_of_the_graph() -> None:
    value = station()
    value["nodes"].append({"id": "timer_1", "parent": "station", "type": "container"})
    lab, _ = bind(value)
    assert {key for key in drivers(lab) if key.startswith("timer")} == {"timer_2", "timer_3"}
    assert lab.tree.by_key["timer_2"].kind == "timer"
    assert lab.tree.by_key["timer_1"].kind == "vessel"


def test_two_nodes_at_one_vessel_become_one_device_where_a_binding_says_so() -> None:
    plain = json.loads(RAW)
    plate: Value = {
        "name": "plate",
        "driver": "drivers.processing.ika_rct_digital:IkaRctDigital",
        "roles": {"heater": ["virtual_heatchill"], "stirrer": ["virtual_stirrer"]},
        "join": {"by": "vessel", "media": ["mechanical", "thermal"]},
        "simulator": {"model": "ika_rct_digital"},
    }
    plain["devices"] = [plate]
    lab, _ = bind(station(), read_binding(json.dumps(plain).encode()))
    assert nodes(lab, "heater") == {"heater": "heater", "stirrer": "stirrer"}


def integrated(sort: str, *ports: str, **config: object) -> Value:
    """bottle ──port── pump with a valve of its own, by links of the type physical"""
    bottles = [
        {"id": f"at_{port}", "parent": "station", "type": "container", "config": {}}
        for port in ports
    ]
    links = [
        {"source": "pump", "target": f"at_{port}", "type": "physical", "port": {"pump": port}}
        for port in ports
    ]
    head = [{"id": "station", "type": "device", "class": "workstation"}, node("pump", sort)]
    head[1]["config"] = {"max_volume": 25, **config}
    return {"nodes": [*head, *bottles], "links": links}


@pytest.mark.parametrize(
    ("sort", "ports", "count"),
    [
        ("syringepump.runze", ("1", "2"), 2),
        ("syringepump.runze", ("1", "7"), 7),
        ("syringe_pump_with_valve.runze.SY03B-T06", ("1", "2"), 6),
        ("syringe_pump_with_valve.runze.SY03B-T08", ("1", "2"), 8),
    ],
)
def test_a_pump_with_a_valve_of_its_own_is_one_device_that_selects_its_ports(
    sort: str, ports: tuple[str, ...], count: int
) -> None:
    lab, notes = bind(integrated(sort, *ports, address="2"))
    assert notes == []
    assert drivers(lab) == {"pump": "RunzeSy03b"} | TIMERS
    assert nodes(lab, "pump") == {"pump": "pump", "valve": "pump"}
    assert lab.devices[0].config == {"syringe_ul": 25_000, "ports_count": count, "address": "2"}
    assert {link.medium for link in lab.connections} == {Medium.LIQUID}
    bench = bench_for(lab, dict(endpoints_needed(lab)))
    ports_there = bench["instruments"][0]["attached"]["ports"]
    assert ports_there == {port: {"vessel": f"at_{port}"} for port in ports}


@pytest.mark.parametrize(
    ("sort", "port", "reason"),
    [
        ("syringe_pump_with_valve.runze.SY03B-T06", "7", "is not a number from 1 to 6"),
        ("syringepump.runze", "top", "has no tube at a numbered port"),
    ],
)
def test_a_pump_with_a_tube_where_its_valve_has_no_port_stays_unbound(
    sort: str, port: str, reason: str
) -> None:
    lab, notes = bind(integrated(sort, port))
    assert lab.devices == ()
    assert any(reason in note for note in notes)


def test_a_link_of_type_physical_carries_what_stands_at_its_ends() -> None:
    """vacuum ── flask ── stirrer;  gas ── valve ── flask"""
    value = station()
    value["nodes"] += [
        node("vacuum", "virtual_vacuum_pump"),
        {**node("gas", "virtual_gas_source"), "data": {"gas_type": "nitrogen"}},
        node("turner", "virtual_stirrer"),
        node("stranger", "oven.acme"),
    ]
    ends = [("vacuum", "flask"), ("turner", "flask"), ("gas", "valve"), ("stranger", "flask")]
    drawn = [{"id": a, "source": a, "target": b, "type": "physical"} for a, b in ends]
    value["links"] += [*drawn, {"id": "tube", "source": "gas", "target": "flask", "type": "fluid"}]
    lab, _ = bind(value)
    media = {link.key: link.medium for link in lab.connections}
    assert (media["vacuum"], media["turner"]) == (Medium.VACUUM, Medium.MECHANICAL)
    assert (media["gas"], media["tube"], media["stranger"]) == (
        *(Medium.GAS, Medium.GAS),
        Medium.OTHER,
    )
    assert lab.tree.by_key["gas"].config == {"gas": "nitrogen"}


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
    assert drivers(lab) == {"heater": "HuberPb", "stirrer": "IkaMicrostar75"} | TIMERS
    assert any(reason in note for note in notes)


@pytest.mark.parametrize(
    ("link", "changes", "reason"),
    [
        (0, {"type": "logical"}, "no pump is joined to it"),
        (0, {"port": {"pump": "a", "valve": "8"}}, "no pump is joined to it"),
        (1, {"port": {"valve": "inlet", "flask": "top"}}, "neither 'transferpump' nor a number"),
        (1, {"port": {"valve": "9", "flask": "top"}}, "a number from 1 to 8"),
    ],
)
def test_a_pump_that_is_not_joined_as_the_rule_says_turns_no_valve(
    link: int, changes: Value, reason: str
) -> None:
    value = station()
    value["links"][link] |= changes
    lab, notes = bind(value)
    # One without a valve is a device by itself; one on a valve that cannot be made is none.
    assert drivers(lab).get("pump") == ("ChemputerPump" if link == 0 else None)
    assert lab.tree.by_key["valve"].id not in {n for d in lab.devices for n in d.nodes.values()}
    assert any(reason in note for note in notes)


def test_two_pumps_on_one_valve_are_not_chosen_between() -> None:
    value = station()
    value["nodes"].append(node("other", "virtual_transfer_pump", max_volume=5))
    value["links"].append(value["links"][0] | {"source": "other", "port": {"other": "a"}})
    value["links"][-1]["port"]["valve"] = "transferpump"
    lab, notes = bind(value)
    assert {drivers(lab)[key] for key in ("pump", "other")} == {"ChemputerPump"}
    assert any("several nodes as pump share it" in note for note in notes)


def test_an_unmapped_class_is_listed() -> None:
    value = station()
    value["nodes"].append(node("oven", "oven.acme"))
    lab, notes = bind(value)
    assert notes == ["oven: class 'oven.acme': it is mapped to no kind"]
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
