"""The C-815 over HTTP: a system that keeps to the maker's document, and one that does not."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from drivers.load import read_statuses
from drivers.processing import buchi_c815
from drivers.processing.buchi_c815 import INFO, PROCESS, BuchiC815, encode_parts, take
from drivers.transports.http import HttpTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
    UnreachableError,
)
from tests.corpus import INSTRUMENTS, NO_INSTRUMENTS
from tests.drivers.conformance.placed_models import Doing
from tests.fixtures.running import until

DOCUMENT = INSTRUMENTS / "buchi/buchi_c815_openapi.json"
FLOW = {
    "rate_ul_s": 500.0,
    "line_1_ratio": 0.7,
    "line_2_ratio": 0.3,
    "line_3_ratio": 0.0,
    "line_4_ratio": 0.0,
}
MIXTURE = {"line1Percentage": 70.0, "line2Percentage": 30.0, "line3Percentage": 0.0} | {
    "line4Percentage": 0.0
}


class System:
    """What the document says of Info and Process, in a few lines."""

    def __init__(self) -> None:
        self.model = "C-815 Flash"
        self.process: dict[str, Any] = {
            "runningState": "Idle",
            "runMode": "Flash",
            "sensors": {"solventPressureAfterPump": 4.5, "solventLevels": None},
            "solventSystem": {
                "flowIsEnabled": False,
                "flowRate": 1,
                "solventMixture": None,
                "sampleInjectionValvePos": "Load",
            },
            "fractionCollector": {"position": None, "collectionTask": {"action": "Waste"}},
        }
        self.puts: list[dict[str, Any]] = []
        self.takes = True
        self.status = 200
        self.spoil: Callable[[str, bytes], bytes | None] = lambda _, body: body

    def get(self, path: str) -> Any:  # noqa: ANN401 - JSON
        return {"systemModel": self.model, "systemName": None} if path == INFO else self.process

    def put(self, parts: dict[str, Any]) -> None:
        self.puts.append(parts)
        if not self.takes or self.status != 200:
            return
        for part, values in parts.items():
            self.process[part] = {**self.process[part], **values}


@contextmanager
def serving(system: System) -> Iterator[int]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.answer("GET", 200, json.dumps(system.get(self.path)).encode())

        def do_PUT(self) -> None:
            length = int(self.headers["Content-Length"])
            assert self.headers["Content-Type"] == "application/json"
            assert self.path == PROCESS
            system.put(json.loads(self.rfile.read(length)))
            detail = json.dumps({"title": "Bad request", "detail": "not now"}).encode()
            self.answer("PUT", system.status, b"" if system.status == 200 else detail)

        def answer(self, method: str, status: int, body: bytes) -> None:
            found = system.spoil(method, body)
            if found is None:
                time.sleep(0.6)
                return
            self.send_response(status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(found)

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    try:
        yield int(server.server_address[1])
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.fixture
def system() -> System:
    return System()


@pytest.fixture
def device(system: System, monkeypatch: pytest.MonkeyPatch) -> Iterator[BuchiC815]:
    monkeypatch.setattr(buchi_c815, "ANSWER_S", 0.3)
    with serving(system) as port:
        device = made(port)
        device.connect()
        yield device
        device.close()


def made(port: int, **config: float) -> BuchiC815:
    line = make_transport(f"http://127.0.0.1:{port}")
    assert isinstance(line, HttpTransport)
    settings = {"max_rate_ul_s": 1000.0, "max_pressure_kpa": 1000.0, "settle_s": 0.01}
    return BuchiC815(line, {**settings, "poll_s": 0.01, "start_limit_s": 0.3, **config})


def test_a_mixture_flows_and_is_stopped(system: System, device: BuchiC815) -> None:
    evidence = device.start_flow(**FLOW).evidence
    assert evidence == {
        "is_running": True,
        "rate_setpoint_ul_s": 500.0,
        "pressure_kpa": 450.0,
        "position": "load",
    }
    wanted = {"flowIsEnabled": True, "flowRate": 30, "solventMixture": MIXTURE}
    assert system.puts == [{"solventSystem": wanted}]
    assert read_statuses(device) == {
        "is_running": True,
        "rate_setpoint_ul_s": 500.0,
        "pressure_kpa": 450.0,
        "position": "load",
        "collects_to": "waste",
        "running_state": "Idle",
    }
    assert device.stop_flow().evidence["is_running"] is False
    assert system.puts[1] == {"solventSystem": {"flowIsEnabled": False}}


def test_valve_and_collector_go_where_they_are_sent(system: System, device: BuchiC815) -> None:
    system.process["runningState"] = "Separating"  # as it is while solvent flows
    device.select_position("separation")
    device.collect("vial")
    assert (device.position(), device.collects_to()) == ("separation", "vial")
    assert system.puts == [
        {"solventSystem": {"sampleInjectionValvePos": "Separation"}},
        {"fractionCollector": {"collectionTask": {"action": "Vial"}}},
    ]


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"rate_ul_s": 1001.0}, "device.limit"),
        ({"rate_ul_s": 0.0}, "device.limit"),
        ({"rate_ul_s": 505.0}, "device.resolution"),
        ({"line_1_ratio": 0.6}, "device.limit"),
        ({"line_3_ratio": 0.1}, "device.limit"),
    ],
)
def test_what_cannot_be_is_refused_before_a_byte_is_sent(
    device: BuchiC815, changed: dict[str, float], code: str
) -> None:
    sent: list[bytes] = []
    device.transport.observer = lambda _, data: sent.append(data)
    with pytest.raises(PreconditionError) as caught:
        device.start_flow(**{**FLOW, **changed})
    assert (caught.value.code, caught.value.effect) == (code, Effect.NONE)
    assert sent == []


@pytest.mark.parametrize("state", ["Preparing", "Cleaning"])
def test_a_system_that_runs_its_own_program_is_left_alone(
    system: System, device: BuchiC815, state: str
) -> None:
    system.process["runningState"] = state
    with pytest.raises(RejectedError, match=state) as caught:
        device.start_flow(**FLOW)
    assert caught.value.effect is Effect.NONE
    assert system.puts == []


def test_a_refusal_has_no_effect_and_a_failure_is_unknown(
    system: System, device: BuchiC815
) -> None:
    system.status = 400
    with pytest.raises(RejectedError, match="not now") as refused:
        device.start_flow(**FLOW)
    assert (refused.value.effect, len(system.puts)) == (Effect.NONE, 1)
    system.status = 500
    with pytest.raises(DeviceError) as failed:
        device.start_flow(**FLOW)
    assert failed.value.effect is Effect.UNKNOWN
    assert system.puts[-1] == {"solventSystem": {"flowIsEnabled": False}}


def test_what_is_not_taken_is_no_success(system: System, device: BuchiC815) -> None:
    system.takes = False
    with pytest.raises(DeviceError) as caught:
        device.start_flow(**FLOW)
    assert (caught.value.code, caught.value.effect) == ("device.slow", Effect.PARTIAL)
    assert caught.value.context["is_running"] is False


def test_too_much_pressure_stops_the_pump(system: System, device: BuchiC815) -> None:
    system.process["sensors"]["solventPressureAfterPump"] = 11.0
    with pytest.raises(DeviceError, match="1100 kPa") as caught:
        device.start_flow(**FLOW)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.PARTIAL)
    assert system.process["solventSystem"]["flowIsEnabled"] is False


def test_a_lost_answer_is_unknown_and_the_flow_not_started_again(
    system: System, device: BuchiC815
) -> None:
    system.spoil = lambda method, body: None if method == "PUT" else body
    with pytest.raises(DeviceTimeoutError) as caught:
        device.start_flow(**FLOW)
    assert caught.value.effect is Effect.UNKNOWN
    started = [put for put in system.puts if put["solventSystem"]["flowIsEnabled"]]
    assert len(started) == 1


def test_silence_before_the_flow_has_no_effect(system: System, device: BuchiC815) -> None:
    system.spoil = lambda _, __: None
    with pytest.raises(DeviceTimeoutError) as caught:
        device.start_flow(**FLOW)
    assert caught.value.effect is Effect.NONE
    assert system.puts == []


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b'{"solventSystem": {"flowRate": "3"}}'])
def test_a_garbled_answer_is_never_a_value(system: System, device: BuchiC815, body: bytes) -> None:
    system.spoil = lambda _, told: body.ljust(len(told))
    with pytest.raises(FrameError):
        device.rate_setpoint_ul_s()


@pytest.mark.parametrize("value", [None, True, "4.5", float("nan")])
def test_a_pressure_that_is_no_number_is_never_told(value: object) -> None:
    process = {"sensors": {"solventPressureAfterPump": value}}
    with pytest.raises(FrameError):
        take(process, "sensors.solventPressureAfterPump", (int, float))


def test_a_stop_turns_the_pump_off(system: System) -> None:
    with serving(system) as port:
        device = made(port, settle_s=20.0)
        device.connect()
        doing = Doing(device, ("start_flow", FLOW))
        until(lambda: bool(system.process["solventSystem"]["flowIsEnabled"]))
        device.stop()
        error = doing.failure()
        device.close()
    assert (error.code, error.effect) == ("device.stopped", Effect.PARTIAL)
    assert error.context["is_running"] is False


def test_power_lost_in_mid_action_is_unknown(system: System) -> None:
    with serving(system) as port:
        device = made(port, settle_s=0.5)
        device.connect()
        doing = Doing(device, ("start_flow", FLOW))
        until(lambda: bool(system.process["solventSystem"]["flowIsEnabled"]))
    error = doing.failure()
    device.close()
    assert isinstance(error, UnreachableError)
    assert error.effect is Effect.UNKNOWN


def test_another_model_is_not_connected(system: System) -> None:
    system.model = "C-830 Prep"
    with serving(system) as port, pytest.raises(RejectedError, match="C-830") as caught:
        made(port).connect()
    assert caught.value.effect is Effect.NONE


@pytest.mark.skipif(not DOCUMENT.exists(), reason=NO_INSTRUMENTS)
def test_what_is_asked_and_put_stands_in_the_published_document() -> None:
    document = json.loads(DOCUMENT.read_text("utf-8"))
    schemas = document["components"]["schemas"]
    assert set(document["paths"][PROCESS]) >= {"get", "put"}
    assert "get" in document["paths"][INFO]
    parts = json.loads(encode_parts(solventSystem={"flowRate": 1, "solventMixture": MIXTURE}))
    assert set(parts) <= set(schemas["Process"]["properties"])
    assert set(parts["solventSystem"]) <= set(schemas["SolventSystemData"]["properties"])
    assert set(MIXTURE) == set(schemas["SolventMixture"]["properties"])
    assert set(buchi_c815.POSITIONS.values()) == set(schemas["SampleInjectionValvePos"]["enum"])
    assert set(buchi_c815.TARGETS.values()) == set(schemas["CollectionAction"]["enum"])
    assert set(schemas["RunningState"]["enum"]) >= buchi_c815.OWN_PROGRAMS
    assert "solventPressureAfterPump" in schemas["SensorData"]["properties"]
