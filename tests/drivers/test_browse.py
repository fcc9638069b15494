"""What SiLA 2 servers and OpenAPI documents say of themselves, as specs."""

import json
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from uuid import uuid4

import msgspec
import pytest
from sila2.server.encryption import generate_self_signed_certificate

from drivers.browse import openapi
from drivers.browse.__main__ import main
from drivers.browse.openapi import MOST_BYTES, browse_document
from drivers.browse.sila import scale_of
from drivers.transports.sila.features import UnitConversion
from labweb.domain.enrollment.driver_spec import check_arguments, encode, parse
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


@contextmanager
def serving(
    status: int,
    body: bytes,
    headers: dict[str, str] | None = None,
    encryption: ssl.SSLContext | None = None,
    until: threading.Event | None = None,
) -> Iterator[tuple[str, list[str]]]:
    """Answer every request in one way; yields the address and what was asked for."""
    asked: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(status)
            for name, value in {"Content-Length": str(len(body)), **(headers or {})}.items():
                self.send_header(name, value)
            self.end_headers()
            with suppress(OSError):
                self.wfile.write(body)
            if until is not None:
                until.wait(20)

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        if encryption is not None:
            server.socket = encryption.wrap_socket(server.socket, server_side=True)
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        scheme = "http" if encryption is None else "https"
        yield f"{scheme}://127.0.0.1:{server.server_port}/openapi.json?v=3", asked
        server.shutdown()
        thread.join()


def test_a_document_is_read_from_the_device_itself(capsys: pytest.CaptureFixture[str]) -> None:
    with serving(200, json.dumps(DOCUMENT).encode()) as (url, asked):
        assert main([url, "/pump"]) == 1
    assert asked == ["/openapi.json?v=3"]
    found = msgspec.json.encode(browse_document(DOCUMENT, "/pump"))
    assert json.loads(capsys.readouterr().out) == json.loads(found)


def test_a_redirect_is_told_and_not_followed(capsys: pytest.CaptureFixture[str]) -> None:
    with (
        serving(200, json.dumps(DOCUMENT).encode()) as (there, asked),
        serving(302, b"", {"Location": there}) as (url, _),
    ):
        assert main([url, "/pump"]) == 2
    assert asked == []
    told = capsys.readouterr().err
    assert "browse.address" in told
    assert f"leads to {there}" in told


@pytest.mark.parametrize(
    ("status", "body", "code"),
    [
        (404, b"{}", "browse.address"),
        (200, b"<html>", "browse.file"),
        (200, b"[" * 100_000, "browse.file"),
        (200, b" " * (MOST_BYTES + 1), "device.frame"),
    ],
)
def test_what_a_server_gives_is_no_document_until_it_is_read(
    status: int, body: bytes, code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with serving(status, body) as (url, _):
        assert main([url, "/pump"]) == 2
    assert capsys.readouterr().err.startswith(f"{code}: ")


def test_a_server_that_stops_in_mid_answer_is_given_up_in_time(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(openapi, "FETCH_S", 0.2)
    given_up = threading.Event()
    with serving(200, b"{", {"Content-Length": "100"}, until=given_up) as (url, _):
        assert main([url, "/pump"]) == 2
        given_up.set()
    assert "no whole answer in time" in capsys.readouterr().err


@pytest.mark.parametrize(
    "url",
    ["http://", "http://user@127.0.0.1/a.json", "http://127.0.0.1:99999/a.json", "https://[/a"],
)
def test_an_address_that_is_none_is_refused(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([url, "/pump"]) == 2
    assert "browse.address" in capsys.readouterr().err


def test_a_certificate_that_nobody_trusts_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    key, chain = generate_self_signed_certificate(uuid4(), "127.0.0.1")
    (tmp_path / "both.pem").write_bytes(key + chain)
    (tmp_path / "known.pem").write_bytes(chain)
    own = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    own.load_cert_chain(tmp_path / "both.pem")
    with serving(200, json.dumps(DOCUMENT).encode(), encryption=own) as (url, asked):
        assert main([url, "/pump"]) == 2
        assert "certificate" in capsys.readouterr().err
        assert asked == []
        monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "known.pem"))
        assert main([url, "/pump"]) == 1
    assert asked == ["/openapi.json?v=3"]


@pytest.mark.parametrize(
    ("unit", "scale"),
    [
        (UnitConversion("K", 1.0, 0.0, (("Kelvin", 1),)), ("c", 1.0, -273.15)),
        (UnitConversion("K", 1.0, 0.0, (("Kelvin", 0),)), ("c", 1.0, -273.15)),
        (UnitConversion("°C", 1.0, 273.15, (("Kelvin", 1),)), ("c", 1.0, 0.0)),
        (UnitConversion("min", 60.0, 0.0, (("Second", 1),)), ("s", 60.0, 0.0)),
        (
            UnitConversion("mL/min", 1e-6 / 60, 0.0, (("Second", -1), ("Meter", 3))),
            ("ul_s", 16.666666666667),
        ),
        (
            UnitConversion("bar", 1e5, 0.0, (("Meter", -1), ("Kilogram", 1), ("Second", -2))),
            ("kpa", 100.0),
        ),
        (UnitConversion("lx", 1.0, 0.0, (("Candela", 1), ("Meter", -2))), None),
    ],
)
def test_a_unit_is_known_by_what_it_is_in_si(
    unit: UnitConversion, scale: tuple[object, ...] | None
) -> None:
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
