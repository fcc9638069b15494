"""Each role of a driver has its place in the tree, or a reason why it has none."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from drivers.catalog.inspect import PACKAGE, known_interfaces
from drivers.catalog.scan import scan
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.graph.device_parts import injected, list_reasons
from labweb.domain.graph.device_parts_by_role import SORTS, WITHOUT_PARTS
from labweb.domain.graph.lab_file.resource_config import check_config
from labweb.domain.resources.resource_kinds import KINDS, Nature, is_vessel

ROLES = sorted(interface.role for interface in known_interfaces().values())
SPECS = scan(PACKAGE).drivers
PAGE = Path(__file__).parents[3] / "docs" / "edge.md"

SETTINGS: dict[str, Any] = {
    "syringe_ul": 1000.0,
    "ports_count": 6,
    "loop_ul": 20.0,
    "vessel_ul": 250_000.0,
    "slots_count": 2,
    "deck": {"10": "opentrons/b/1", "2": "opentrons/a/1"},
    "min_temperature_c": 5.0,
    "max_temperature_c": 300.0,
    "min_speed_rpm": 50.0,
    "max_speed_rpm": 900.0,
}

_HEAT = {"min_temperature_c": 5.0, "max_temperature_c": 300.0}
_TURN = {"min_speed_rpm": 50.0, "max_speed_rpm": 900.0}

BROUGHT: dict[str, list[tuple[str, str, dict[str, Any]]]] = {
    "agv": [("d", "agv", {})],
    "analyser": [("d", "analyser", {}), ("d_tray", "carrier", {})],
    "arm": [("d", "arm", {})],
    "balance": [("d", "balance", {})],
    "battery_tester": [("d", "battery_tester", {}), ("d_cell", "slot", {})],
    "camera": [("d", "camera", {})],
    "chromatography": [
        ("d", "chromatography", {}),
        ("d_column", "slot", {}),
        ("d_collector", "carrier", {}),
    ],
    "compute": [("d", "compute", {})],
    "conductivity_sensor": [("d", "transmitter", {})],
    "continuous_pump": [("d", "continuous_pump", {})],
    "flow_sensor": [("d", "transmitter", {})],
    "furnace": [("d", "furnace", _HEAT)],
    "gantry": [("d", "gantry", {})],
    "gripper": [("d", "gripper", {}), ("d_fingers", "slot", {})],
    "heater_stirrer": [("d", "heater_stirrer", _HEAT | _TURN)],
    "infusion_pump": [("d", "syringe_pump", {"capacity_ul": 1000.0})],
    "injection_valve": [
        ("d", "injection_valve", {}),
        ("d_loop", "sample_loop", {"capacity_ul": 20.0}),
    ],
    "liquid_handler": [
        ("d", "liquid_handler", {}),
        ("d_pipette", "pipette_channel", {}),
        ("d_deck", "deck", {}),
        ("d_deck/2", "slot", {}),
        ("d_deck/10", "slot", {}),
    ],
    "node": [],
    "ph_sensor": [("d", "transmitter", {})],
    "plate_reader": [("d", "plate_reader", _HEAT), ("d_drawer", "slot", {})],
    "potentiostat": [("d", "potentiostat", {})],
    "powder_dispenser": [
        ("d", "powder_dispenser", {}),
        ("d_head", "slot", {}),
        ("d_vial", "slot", {}),
    ],
    "power_supply": [("d", "power_supply", {})],
    "pump": [("d", "syringe_pump", {"capacity_ul": 1000.0})],
    "rotary_evaporator": [("d", "rotary_evaporator", _HEAT | _TURN)],
    "separator": [
        ("d", "phase_separator", _TURN),
        ("d_vessel", "separator", {"capacity_ul": 250_000.0}),
    ],
    "shaker": [("d", "shaker", _HEAT | _TURN), ("d_plate", "slot", {})],
    "showing": [],
    "spectrometer": [("d", "spectrometer", {}), ("d_bore", "slot", {})],
    "stirrer": [("d", "stirrer", _TURN)],
    "storage": [
        ("d", "storage", {}),
        ("d_slot_1", "slot", {}),
        ("d_slot_2", "slot", {}),
        ("d_transfer", "slot", {}),
    ],
    "tds_sensor": [("d", "transmitter", {})],
    "temperature_controller": [("d", "heater", _HEAT)],
    "temperature_sensor": [("d", "transmitter", {})],
    "thermostat": [("d", "thermostat", _HEAT)],
    "timer": [("d", "timer", {})],
    "vacuum_controller": [("d", "vacuum_controller", {})],
    "valve": [("d", "rotary_valve", {"ports_count": 6, "common_port": "common"})],
}
"""Key, kind and configuration of what each role brings with the settings above."""


def a_driver(*roles: str) -> DriverSpec:
    return DriverSpec(class_name="D", module="m", digest="", roles=roles)


def test_every_role_stands_in_one_of_the_two_tables() -> None:
    assert sorted([*SORTS, *WITHOUT_PARTS]) == ROLES == sorted(BROUGHT)


@pytest.mark.parametrize("role", ROLES)
def test_a_role_brings_what_a_device_of_it_is_and_has(role: str) -> None:
    made = injected(a_driver(role), SETTINGS, key="d", name="D")
    assert [(one.key, one.kind, dict(one.config)) for one in made.parts] == BROUGHT[role]
    assert set(made.nodes.values()) == ({"d"} if BROUGHT[role] else set())
    assert bool(list_reasons(a_driver(role))) is not bool(made.parts)


@pytest.mark.parametrize("role", SORTS)
def test_what_a_role_brings_is_what_the_tree_allows(role: str) -> None:
    parts = injected(a_driver(role), SETTINGS, key="d", name="D").parts
    places = {one.key for one in parts if KINDS[one.kind].is_place}
    assert KINDS[parts[0].kind].nature is not Nature.RESOURCE or role == "storage"
    for index, part in enumerate(parts):
        assert check_config(part.kind, part.config, part.key) == []
        assert part.inside == "" or part.inside in places & {one.key for one in parts[:index]}


@pytest.mark.parametrize("role", SORTS)
def test_what_no_setting_tells_stays_unknown(role: str) -> None:
    for part in injected(a_driver(role), {}, key="d", name="D").parts:
        assert set(part.config) <= {"common_port"}
        assert not is_vessel(part.kind) or part.config.get("capacity_ul") is None


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.class_name)
def test_every_driver_of_the_catalog_brings_something_or_says_why(spec: DriverSpec) -> None:
    made = injected(spec, {}, key="d", name="D")
    assert bool(made.parts) is not bool(list_reasons(spec))
    acting = {action.role for action in spec.actions} & set(SORTS)
    own = {name for role in acting for name in (role, *SORTS[role].roles)}
    assert not made.parts or own & set(made.nodes)


@pytest.mark.parametrize(
    ("roles", "kind"),
    [
        (("plate_reader", "temperature_controller"), "plate_reader"),
        (("temperature_controller", "plate_reader"), "plate_reader"),
        (("shaker", "temperature_controller"), "shaker"),
    ],
)
def test_what_heats_a_plate_acts_through_that_in_which_the_plate_stands(
    roles: tuple[str, ...], kind: str
) -> None:
    made = injected(a_driver(*roles), SETTINGS, key="d", name="D")
    assert [part.kind for part in made.parts] == [kind, "slot"]
    assert made.nodes == dict.fromkeys(roles, "d")
    assert made.parts[0].config["max_temperature_c"] == 300.0


def test_the_page_tells_each_role_with_what_it_brings() -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*?) \|$", PAGE.read_text("utf-8"), re.MULTILINE))
    for role, parts in BROUGHT.items():
        told = [word for word in re.findall(r"`(\w+)`", rows[role]) if word in KINDS]
        assert list(dict.fromkeys(told)) == list(dict.fromkeys(kind for _, kind, _ in parts)), role
