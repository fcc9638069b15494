"""What a device brings into the tree follows from its driver's roles and its settings alone."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from drivers.load import read_spec
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.graph.device_parts import injected
from labweb.domain.graph.device_parts_changes import decision_of, find_changes, list_changes
from labweb.domain.graph.lab_file.resource_config import check_config

CONFIGS: dict[str, dict[str, float]] = {
    "drivers.connectors.tricontinent_c3000": {"syringe_ul": 5000.0, "ports_count": 8},
    "drivers.processing.ika_rct_digital": {},
    "drivers.logistics.cytomat": {"slots_count": 3},
    "drivers.sensors.seeed_tds": {},
    "drivers.sensors.mettler_sics": {},
}


def made_by(module: str):  # type: ignore[no-untyped-def]  # noqa: ANN201
    return injected(read_spec(module), CONFIGS[module], key="d", name="D")


def test_a_pump_with_its_valve_brings_both_and_the_tube_between() -> None:
    """syringe outlet ── common valve 1…8."""
    made = made_by("drivers.connectors.tricontinent_c3000")
    assert [(part.key, part.kind, dict(part.config)) for part in made.parts] == [
        ("d", "syringe_pump", {"capacity_ul": 5000.0}),
        ("d_valve", "rotary_valve", {"ports_count": 8, "common_port": "common"}),
    ]
    (tube,) = made.tubes
    assert (tube.source, tube.source_port, tube.target, tube.target_port) == (
        *("d", "outlet"),
        *("d_valve", "common"),
    )
    assert made.nodes == {"pump": "d", "valve": "d_valve"}


def test_a_store_brings_each_of_its_places_and_its_transfer_station() -> None:
    made = made_by("drivers.logistics.cytomat")
    assert [part.kind for part in made.parts] == ["storage", "slot", "slot", "slot", "slot"]
    assert {part.inside for part in made.parts[1:]} == {"d"}
    assert made.parts[-1].key == "d_transfer"


def test_a_probe_of_two_quantities_is_one_part() -> None:
    made = made_by("drivers.sensors.seeed_tds")
    assert [part.kind for part in made.parts] == ["transmitter"]
    assert set(made.nodes) == {"conductivity_sensor", "transmitter"}


@pytest.mark.parametrize("module", CONFIGS)
def test_what_is_brought_is_what_the_tree_allows(module: str) -> None:
    for part in made_by(module).parts:
        assert check_config(part.kind, part.config, part.key) == []


def test_a_driver_of_no_role_in_the_tree_brings_nothing() -> None:
    made = injected(read_spec("drivers.virtual.ros2_node"), {}, key="d", name="D")
    assert (made.parts, made.tubes) == ((), ())


def with_roles(*roles: str) -> DriverSpec:
    return DriverSpec(class_name="D", module="m", digest="", roles=roles)


def changes(old: DriverSpec, new: DriverSpec, **config: Any) -> list[tuple[str, str]]:  # noqa: ANN401
    found = find_changes(old, new, config, key="device", name="device")
    told = list_changes(found, new.class_name)
    assert bool(told) is bool(decision_of(found, new.class_name)) is bool(found)
    return [(one.code.removeprefix("driver.parts_"), one.subject) for one in told]


@pytest.mark.parametrize(
    ("before", "after", "found"),
    [
        (("pump",), ("pump", "valve"), [("gained", "device_valve"), ("gained", "device.outlet")]),
        (("pump", "valve"), ("pump",), [("lost", "device_valve"), ("lost", "device.outlet")]),
        (("heater_stirrer",), ("thermostat",), [("gained", "device"), ("lost", "device")]),
        (("ph_sensor",), ("ph_sensor", "showing"), []),
        (("ph_sensor",), ("ph_sensor", "camera"), [("gained", "device_camera")]),
        (("liquid_handler",), ("liquid_handler", "showing"), []),
        (("shaker",), ("shaker", "temperature_controller"), [("changed", "device")]),
        (("pump", "valve"), ("pump", "valve"), []),
        (("pump", "valve"), ("valve", "pump"), []),
        (
            ("ph_sensor",),
            ("ph_sensor", "conductivity_sensor"),
            [("changed", "device")],
        ),
    ],
)
def test_a_version_with_other_parts_is_told_from_one_with_the_same(
    before: tuple[str, ...], after: tuple[str, ...], found: list[tuple[str, str]]
) -> None:
    assert changes(with_roles(*before), with_roles(*after)) == found


def test_who_agreed_to_one_list_of_parts_has_not_agreed_to_another() -> None:
    pump, both = with_roles("pump"), with_roles("pump", "valve")
    there = find_changes(pump, both, {}, key="d", name="D")
    back = find_changes(both, pump, {}, key="d", name="D")
    assert len({decision_of(there, "P"), decision_of(back, "P"), decision_of(there, "Q")}) == 3


def test_a_store_with_fewer_places_has_lost_each_of_them() -> None:
    spec = read_spec("drivers.logistics.cytomat")
    places = [one for one in spec.config if one.name != "slots_count"]
    (count,) = [one for one in spec.config if one.name == "slots_count"]
    fewer, more = (
        msgspec.structs.replace(
            spec,
            config=(*places, msgspec.structs.replace(count, default=n, required=False)),
        )
        for n in (2, 3)
    )
    assert changes(more, fewer) == [("lost", "device_slot_3")]
    assert changes(fewer, more) == [("gained", "device_slot_3")]
    assert changes(more, fewer, slots_count=3) == []


def test_a_deck_with_fewer_slots_has_lost_each_of_them_and_stays() -> None:
    spec = read_spec("drivers.processing.opentrons_ot2")
    places = [one for one in spec.config if one.name != "deck"]
    (deck,) = [one for one in spec.config if one.name == "deck"]
    one, both = (
        msgspec.structs.replace(
            spec,
            config=(*places, msgspec.structs.replace(deck, default=told, required=False)),
        )
        for told in ({"1": "a/b/1"}, {"1": "a/b/1", "7": "a/b/1"})
    )
    assert changes(both, one) == [("lost", "device_deck/7")]
    assert changes(one, both) == [("gained", "device_deck/7")]
