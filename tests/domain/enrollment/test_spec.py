"""A driver's declaration as data: it survives JSON and checks what is sent to the driver."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.dimensions import DIMENSIONS
from labweb.domain.enrollment.driver_spec import (
    UNITS,
    ActionSpec,
    DriverSpec,
    ParameterSpec,
    StatusSpec,
    check_arguments,
    check_config,
    encode,
    parse,
    unit_suffix,
)
from labweb.domain.errors import Finding, NotFoundError

VOLUME = ParameterSpec(
    name="volume_ul", type="number", unit="ul", quantity="volume", minimum=1.0, maximum=5000.0
)
MODE = ParameterSpec(name="mode", type="string", choices=("fast", "slow"), required=False)
COUNT = ParameterSpec(name="rinse_count", type="integer", required=False, nullable=True)
ASPIRATE = ActionSpec(
    name="aspirate",
    parameters=(VOLUME, MODE, COUNT),
    timeout_s=60.0,
    recovery="R2",
    operation="transfer",
    role="pump",
)
STATUS = StatusSpec(name="volume_ul", value=VOLUME, every_s=0.5, role="pump")
PUMP = DriverSpec(
    class_name="Pump",
    module="drivers.connectors.pump",
    digest="0" * 64,
    roles=("pump",),
    actions=(ASPIRATE,),
    statuses=(STATUS,),
    config=(VOLUME,),
    findings=(Finding("driver.drv003", "no unit", "pump.py:3", {"line": 3}),),
)


def codes(arguments: dict[str, Any]) -> list[str]:
    return [finding.code for finding in check_arguments(ASPIRATE, arguments)]


def test_a_spec_survives_json() -> None:
    assert parse(encode(PUMP)) == PUMP


@given(st.text(), st.floats(allow_nan=False, allow_infinity=False), st.booleans())
def test_any_parameter_survives_json(name: str, low: float, is_required: bool) -> None:
    parameter = ParameterSpec(name=name, type="number", minimum=low, required=is_required)
    spec = DriverSpec(class_name="A", module="m", digest="d", config=(parameter,))
    assert parse(encode(spec)) == spec


def test_good_arguments_have_no_findings() -> None:
    assert codes({"volume_ul": 5, "mode": "fast", "rinse_count": None}) == []


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ({}, "driver.argument_missing"),
        ({"volume_ul": 5, "speed": 1}, "driver.argument_unknown"),
        ({"volume_ul": "5 mL"}, "driver.argument_type"),
        ({"volume_ul": True}, "driver.argument_type"),
        ({"volume_ul": float("nan")}, "driver.argument_type"),
        ({"volume_ul": float("inf")}, "driver.argument_type"),
        ({"volume_ul": None}, "driver.argument_type"),
        ({"volume_ul": 0.5}, "driver.argument_range"),
        ({"volume_ul": 5001}, "driver.argument_range"),
        ({"volume_ul": 5, "mode": "medium"}, "driver.argument_choice"),
        ({"volume_ul": 5, "rinse_count": 1.5}, "driver.argument_type"),
    ],
)
def test_a_bad_argument_is_named(arguments: dict[str, Any], code: str) -> None:
    assert codes(arguments) == [code]


def test_settings_are_checked_as_arguments_are() -> None:
    assert [finding.subject for finding in check_config(PUMP, {})] == ["Pump.volume_ul"]


def test_the_schema_of_an_action_carries_unit_quantity_label_and_range() -> None:
    schema = ASPIRATE.schema()
    assert schema["properties"]["volume_ul"] == {
        "type": "number",
        "x-label": "volume_ul",
        "x-quantity": "volume",
        "x-unit": "µL",
        "minimum": 1.0,
        "maximum": 5000.0,
    }
    assert schema["required"] == ["volume_ul"]
    assert schema["additionalProperties"] is False


def test_an_unknown_action_or_status_names_those_there_are() -> None:
    with pytest.raises(NotFoundError) as caught:
        PUMP.action("explode")
    assert caught.value.context == {"actions": ["aspirate"]}
    with pytest.raises(NotFoundError):
        PUMP.status("mood")


ENDS_AS = {"ph_difference": "ph", "share": "ratio"}
"""What a step may write, and the driver's quantity whose end it has."""


def test_every_dimension_a_person_may_write_has_its_unit_here() -> None:
    named = {suffix: quantity for suffix, (quantity, _) in UNITS.items()}
    for dimension in DIMENSIONS.values():
        if dimension.suffix in named:
            assert named[dimension.suffix] == ENDS_AS.get(dimension.name, dimension.name)
            unit = UNITS[dimension.suffix][1]
            assert unit in dimension.units or not unit, "a plain number has none"


@pytest.mark.parametrize(
    ("name", "suffix"),
    [("rate_ul_s", "ul_s"), ("value_ph", "ph"), ("volume", ""), ("is_c", "c"), ("ul", "")],
)
def test_the_unit_is_the_end_of_the_name(name: str, suffix: str) -> None:
    assert unit_suffix(name) == suffix


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("3", "port_index is an integer; got '3'"),
        (99, "port_index is at most 12; got 99"),
        (0, "port_index is at least 1; got 0"),
        pytest.param(10**400, "port_index is at most 12; got 10000000000000000000…", id="huge"),
    ],
)
def test_what_is_wrong_with_an_argument_is_said_in_a_sentence(value: object, words: str) -> None:
    port = ParameterSpec(name="port_index", type="integer", minimum=1, maximum=12)
    turn = ActionSpec(
        name="turn",
        parameters=(port,),
        timeout_s=60.0,
        recovery="R2",
        operation="transfer",
        role="pump",
    )
    (finding,) = check_arguments(turn, {"port_index": value})
    assert finding.message == f"turn: {words}"
