"""What a device brings into the tree follows from its driver's roles and its settings alone."""

from __future__ import annotations

import msgspec
import pytest

from drivers.load import read_spec
from labweb.domain.enrollment.spec import DriverSpec
from labweb.domain.graph.injection import check_parts, injected
from labweb.domain.graph.lab_file.config import check_config

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
    made = injected(read_spec("drivers.logistics.ur_dashboard"), {}, key="d", name="D")
    assert (made.parts, made.tubes) == ((), ())


def with_roles(*roles: str) -> DriverSpec:
    return DriverSpec(class_name="D", module="m", digest="", roles=roles)


@pytest.mark.parametrize(
    ("before", "after", "found"),
    [
        (("pump",), ("pump", "valve"), [("gained", "device.outlet"), ("gained", "device_valve")]),
        (("pump", "valve"), ("pump",), [("lost", "device.outlet"), ("lost", "device_valve")]),
        (("heater_stirrer",), ("thermostat",), [("changed", "device")]),
        (("ph_sensor",), ("ph_sensor", "camera"), []),
        (("pump", "valve"), ("pump", "valve"), []),
    ],
)
def test_a_version_with_other_parts_is_told_from_one_with_the_same(
    before: tuple[str, ...], after: tuple[str, ...], found: list[tuple[str, str]]
) -> None:
    findings = check_parts(with_roles(*before), with_roles(*after), {})
    assert [(one.code.removeprefix("driver.parts_"), one.subject) for one in findings] == found
    assert all("take it up anew" in one.message for one in findings)


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
    (lost,) = check_parts(more, fewer, {})
    assert (lost.code, lost.subject) == ("driver.parts_lost", "device_slot_3")
    assert "place 3" in lost.message
    assert check_parts(more, fewer, {"slots_count": 3}) == []
