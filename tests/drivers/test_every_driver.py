"""What holds for each driver of the catalog."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from drivers.base import ActionMark, Driver, StatusMark
from drivers.catalog.bundle import gather
from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import scan
from drivers.catalog.source import read_source
from drivers.load import source_path
from drivers.transports.urls import make_transport
from labweb.domain.dimensions import DIMENSIONS
from labweb.domain.enrollment.driver_bundle import digest_of
from labweb.domain.enrollment.driver_spec import UNITS, DriverSpec, encode, parse
from labweb.domain.enrollment.setpoint_readback import names_set_by, setting_actions
from labweb.domain.errors import DefinitionError
from labweb.domain.units import parse as parse_quantity

SPECS = scan(PACKAGE).drivers
TESTS = Path(__file__).parent
URLS = {
    "byte": "tcp://127.0.0.1:4305",
    "register": "modbus+tcp://127.0.0.1:502?device=1",
    "http": "http://127.0.0.1:80",
    "opcua": "opc.tcp://127.0.0.1:4840",
    "ros2": "ros2://127.0.0.1/node",
    "sila": "sila+local://127.0.0.1:50052",
    "s7": "s7://127.0.0.1:102/0/1",
    "virtual": "virtual:timer",
}

ANSWERS = frozenset({"has_error"})
READ_BACK = frozenset().union(*map(names_set_by, setting_actions()))

every_driver = pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.class_name)


def test_the_catalog_holds_every_role_that_a_lab_is_built_of() -> None:
    assert {role for spec in SPECS for role in spec.roles} == {
        "agv",
        "analyser",
        "arm",
        "balance",
        "continuous_pump",
        "battery_tester",
        "camera",
        "chromatography",
        "compute",
        "conductivity_sensor",
        "flow_sensor",
        "furnace",
        "gantry",
        "gripper",
        "heater_stirrer",
        "infusion_pump",
        "injection_valve",
        "liquid_handler",
        "node",
        "ph_sensor",
        "plate_reader",
        "potentiostat",
        "powder_dispenser",
        "power_supply",
        "pump",
        "rotary_evaporator",
        "separator",
        "shaker",
        "showing",
        "spectrometer",
        "stirrer",
        "storage",
        "tds_sensor",
        "temperature_controller",
        "temperature_sensor",
        "thermostat",
        "timer",
        "vacuum_controller",
        "valve",
    }


@every_driver
def test_a_driver_keeps_every_rule(spec: DriverSpec) -> None:
    assert spec.findings == ()


@every_driver
def test_a_spec_is_complete(spec: DriverSpec) -> None:
    assert spec.roles
    assert spec.transport
    assert spec.doc
    assert spec.protocol
    assert spec.quality
    assert spec.safe_state
    assert spec.digest == digest_of(gather(read_source(source_path(spec.module))))
    assert all(action.timeout_s and action.doc and action.role for action in spec.actions)
    assert all(status.every_s and status.doc for status in spec.statuses)
    # What shows that something set still stands a driver tells also where its role does not ask,
    # and that it answers at all, where what its role asks for is not known before the first act.
    assert {status.name for status in spec.statuses if not status.role} <= READ_BACK | ANSWERS


@every_driver
def test_every_argument_has_a_type_and_every_number_a_range(spec: DriverSpec) -> None:
    for parameter in [one for action in spec.actions for one in action.parameters]:
        assert parameter.type is not None
        assert parameter.label
        if parameter.type in {"number", "integer"}:
            assert parameter.unit in UNITS
            assert parameter.minimum is not None
            assert parameter.maximum is not None


@every_driver
def test_every_unit_it_shows_can_be_read_back(spec: DriverSpec) -> None:
    for parameter in [one for action in spec.actions for one in action.parameters]:
        if parameter.quantity in DIMENSIONS:
            assert parse_quantity(f"1 {parameter.symbol}", parameter.quantity) is not None


@every_driver
def test_its_schemas_are_json_schema_and_its_spec_survives_json(spec: DriverSpec) -> None:
    for schema in [spec.config_schema(), *(action.schema() for action in spec.actions)]:
        Draft202012Validator.check_schema(schema)
    assert parse(encode(spec)) == spec


@every_driver
def test_text_and_code_agree(spec: DriverSpec) -> None:
    found = getattr(importlib.import_module(spec.module), spec.class_name)
    assert issubclass(found, Driver)
    assert not inspect.isabstract(found)
    assert found.transport_type.sort == spec.transport
    assert set(found.config_type.__struct_fields__) == {one.name for one in spec.config}
    for action in spec.actions:
        mark = vars(getattr(found, action.name))["labweb_action"]
        assert action.timeout_s is not None
        assert mark == ActionMark(
            action.timeout_s, action.recovery, action.hazards, action.operation
        )
    for status in spec.statuses:
        mark = vars(getattr(found, status.name))["labweb_status"]
        assert status.every_s is not None
        assert mark == StatusMark(status.every_s)


@every_driver
def test_what_moves_matter_is_never_repeated_by_itself(spec: DriverSpec) -> None:
    for action in spec.actions:
        assert action.operation != "transfer" or action.recovery in {"R0", "R2", "R3"}


@every_driver
def test_it_has_tests_of_its_own(spec: DriverSpec) -> None:
    _, folder, module = spec.module.split(".")
    assert (TESTS / folder / f"test_{module}.py").is_file()


@every_driver
def test_unknown_settings_are_refused(spec: DriverSpec) -> None:
    found = getattr(importlib.import_module(spec.module), spec.class_name)
    with pytest.raises(DefinitionError, match="no_such_setting"):
        found(make_transport(URLS[spec.transport]), {"no_such_setting": 1})
