"""What SiLA 2 servers and OpenAPI documents say of themselves, as specs."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.browse.__main__ import main
from drivers.browse.openapi import browse_document
from drivers.browse.sila import scale_of
from drivers.transports.sila.features import Unit
from labweb.domain.enrollment.spec import check_arguments, encode, parse
from labweb.domain.errors import NotFoundError
from tests.corpus import INSTRUMENTS, NO_INSTRUMENTS
from tests.drivers.conformance.cases import CONTROLLERS
from tests.drivers.conformance.placed_models import Bench, running

BUCHI = INSTRUMENTS / "buchi/buchi_c815_openapi.json"
CASE = next(case for case in CONTROLLERS if case.model == "sila_controller")
FEATURE = "org.silastandard/examples/TemperatureController/v1"

PUMP = {
    "type": "object",
    "properties": {
        "isOn": {"type": "boolean", "nullable": True},
        "valve": {"nullable": True, "oneOf": [{"$ref": "#/components/schemas/Valve"}]},
        "rate": {"type": "integer"},
        "levels": {"type": "array", "items": {"type": "number"}},
        "state": {"readOnly": True, "oneOf": [{"$ref": "#/components/schemas/State"}]},
        "again": {"$ref": "#/components/schemas/Pump"},
    },
}
DOCUMENT: dict[str, Any] = {
    "info": {"title": "A pump", "version": "v1"},
    "paths": {
        "/pump": {
            "get": {"responses": {"200": {"content": {"application/json": {
                "schema": {"$ref": "#/components/schemas/Pump"}}}}}},
            "put": {"requestBody": {"content": {"application/json": {
                "schema": {"$ref": "#/components/schemas/Pump"}}}}},
        },
        "/pump/zero": {"put": {"operationId": "Pump_Zero", "summary": "Take this as zero."}},
    },
    "components": {"schemas": {
        "Pump": PUMP,
        "Valve": {"type": "string", "enum": ["Load", "Run"]},
        "State": {"type": "string", "enum": ["Idle", "Busy"]},
    }},
}  # fmt: skip


def test_what_is_put_becomes_an_action_and_what_is_only_read_does_not() -> None:
    found = browse_document(DOCUMENT, "/pump")
    spec = found.spec
    assert {"is_on", "valve", "state"} <= {one.name for one in spec.statuses}
    assert "set_state" not in {one.name for one in spec.actions}
    valve = spec.action("set_valve")
    assert check_arguments(valve, {"valve": "Load"}) == []
    assert check_arguments(valve, {"valve": "Nowhere"}) != []
    assert found.bindings["set_valve"].node == "PUT /pump valve"
    assert found.bindings["state"].node == "GET /pump state"
    assert (spec.transport, spec.doc) == ("http", "A pump")
    assert parse(encode(spec)) == spec


def test_a_number_without_a_unit_a_list_and_a_circle_are_left_out_and_told() -> None:
    findings = {(one.code, one.subject) for one in browse_document(DOCUMENT, "/pump").spec.findings}
    assert ("browse.unit", "/pump rate") in findings
    assert ("browse.type", "/pump levels") in findings
    assert any(code == "browse.too_many" for code, _ in findings)


def test_a_path_that_only_acts_is_an_action_and_one_that_is_not_there_is_refused() -> None:
    spec = browse_document(DOCUMENT, "/pump/zero").spec
    assert [(one.name, one.recovery, one.doc) for one in spec.actions] == [
        ("pump_zero", "R3", "Take this as zero.")
    ]
    with pytest.raises(NotFoundError) as caught:
        browse_document(DOCUMENT, "/other")
    assert caught.value.context["names"] == ["/pump", "/pump/zero"]


def test_the_digest_changes_when_the_document_does() -> None:
    changed = json.loads(json.dumps(DOCUMENT))
    before = browse_document(DOCUMENT, "/pump").spec.digest
    assert browse_document(changed, "/pump").spec.digest == before
    changed["components"]["schemas"]["Valve"]["enum"].append("Wash")
    assert browse_document(changed, "/pump").spec.digest != before


@pytest.mark.skipif(not BUCHI.exists(), reason=NO_INSTRUMENTS)
def test_the_published_document_of_the_c815_is_browsed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(BUCHI), "/api/v1/Process"]) == 1
    told = capsys.readouterr()
    spec = json.loads(told.out)["spec"]
    actions = {one["name"] for one in spec["actions"]}
    assert {
        "set_solvent_system_flow_is_enabled",
        "set_solvent_system_sample_injection_valve_pos",
        "set_air_system_valve_pos",
    } <= actions
    assert "set_running_state" not in actions
    assert "solventSystem.flowRate: a number, and the document says no unit" in told.err


@pytest.mark.parametrize("text", ["", "[]", "{"])
def test_a_file_that_is_no_document_is_told(
    tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "openapi.json"
    path.write_text(text)
    assert main([str(path), "/pump"]) == 2
    assert "browse.file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("unit", "scale"),
    [
        (Unit("K", 1.0, 0.0, (("Kelvin", 1),)), ("c", 1.0, -273.15)),
        (Unit("K", 1.0, 0.0, (("Kelvin", 0),)), ("c", 1.0, -273.15)),
        (Unit("°C", 1.0, 273.15, (("Kelvin", 1),)), ("c", 1.0, 0.0)),
        (Unit("min", 60.0, 0.0, (("Second", 1),)), ("s", 60.0, 0.0)),
        (Unit("mL/min", 1e-6 / 60, 0.0, (("Second", -1), ("Meter", 3))), ("ul_s", 16.666666666667)),
        (Unit("bar", 1e5, 0.0, (("Meter", -1), ("Kilogram", 1), ("Second", -2))), ("kpa", 100.0)),
        (Unit("lx", 1.0, 0.0, (("Candela", 1), ("Meter", -2))), None),
    ],
)
def test_a_unit_is_known_by_what_it_is_in_si(unit: Unit, scale: tuple[object, ...] | None) -> None:
    found = scale_of(unit)
    if scale is None:
        assert found is None
        return
    assert found is not None
    assert found[0] == scale[0]
    assert found[1:] == pytest.approx((*scale[1:], 0.0)[:2])


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running([CASE]) as bench:
        yield bench


def test_a_feature_becomes_a_spec_in_our_units(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([bench.url(CASE), FEATURE]) == 0
    found = json.loads(capsys.readouterr().out)
    spec = parse(json.dumps(found["spec"]).encode())
    assert [one.name for one in spec.statuses] == ["current_temperature_c"]
    control = spec.action("control_temperature")
    assert check_arguments(control, {"target_temperature_c": 60.0}) == []
    assert check_arguments(control, {"target_temperature_c": 95.0}) != []
    binding = found["bindings"]["control_temperature"]
    assert binding["node"] == f"{FEATURE}/ControlTemperature"
    assert (binding["factor"], binding["offset"]) == (1.0, -273.15)
    assert (spec.transport, spec.findings) == ("sila", ())


def test_a_feature_that_is_not_there_is_told(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([bench.url(CASE), "org.silastandard/examples/Nothing/v1"]) == 2
    assert "has no feature" in capsys.readouterr().err
