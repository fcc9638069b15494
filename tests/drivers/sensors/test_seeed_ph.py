"""The pH sensor over Modbus TCP, byte for byte."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import pytest

from drivers.load import read_statuses
from drivers.sensors.seeed_ph import SeeedPh, decode_registers
from drivers.transports import modbus
from drivers.transports.base import Transport
from drivers.transports.modbus import RegisterTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import (
    DefinitionError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    RejectedError,
    UnreachableError,
)
from tests.drivers.wire import answering


def frame(request: bytes, pdu: str) -> bytes:
    """Answer a request with its own transaction and device number."""
    body = request[6:7] + bytes.fromhex(pdu)
    return request[:4] + len(body).to_bytes(2, "big") + body


def a_sensor(port: int, device: int = 1, **config: object) -> SeeedPh:
    return on_line(make_transport(f"modbus+tcp://127.0.0.1:{port}?device={device}"), **config)


def on_line(line: Transport, **config: object) -> SeeedPh:
    return SeeedPh(cast("RegisterTransport", line), config)


def using(pdu: str) -> Callable[[bytes], bytes]:
    return lambda request: frame(request, pdu)


def test_temperature_and_ph_are_read_in_one_request() -> None:
    requests: list[bytes] = []

    def answer(request: bytes) -> bytes:
        requests.append(request)
        return frame(request, "03 04 09D0 02BD")

    with answering(answer) as port:
        sensor = a_sensor(port, device=7)
        sensor.connect()
        report = sensor.measure()
        sensor.close()
    assert report.evidence == {"value_ph": 7.01, "temperature_c": 25.12}
    assert [request[6:].hex() for request in requests] == ["070300000002"] * 2


def test_input_registers_are_read_when_set_so() -> None:
    with answering(using("04 04 09D0 02BD")) as port:
        sensor = a_sensor(port, table="input", offset_ph=0.1)
        sensor.connect()
        assert read_statuses(sensor) == {"value_ph": 7.11, "temperature_c": 25.12}
        sensor.close()


def test_bytes_pass_the_observer_once() -> None:
    seen: list[tuple[str, str]] = []
    with answering(using("03 04 09D0 02BD")) as port:
        sensor = a_sensor(port)
        sensor.transport.observer = lambda way, data: seen.append((way, data[6:].hex()))
        sensor.connect()
        sensor.close()
    assert seen == [("out", "010300000002"), ("in", "01030409d002bd")]


def test_two_sensors_share_a_line() -> None:
    with answering(using("03 04 09D0 02BD")) as port:
        line = make_transport(f"modbus+tcp://127.0.0.1:{port}?device=1")
        first = on_line(line)
        second = on_line(line.for_url(f"modbus+tcp://127.0.0.1:{port}?device=2"))
        first.connect()
        second.connect()
        first.close()
        assert second.value_ph() == 7.01
        second.close()
        assert not line.is_open


def test_an_exception_answer_is_a_refusal() -> None:
    with answering(using("83 02")) as port:
        sensor = a_sensor(port)
        with pytest.raises(RejectedError, match="illegal register address") as caught:
            sensor.connect()
    assert caught.value.effect is Effect.NONE
    assert caught.value.context == {"exception_code": 2}


def test_silence_is_a_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(modbus, "OPEN_TIMEOUT_S", 0.2)
    with answering(lambda request: b"") as port:
        sensor = a_sensor(port)
        with pytest.raises(DeviceTimeoutError) as caught:
            sensor.connect()
    assert caught.value.effect is Effect.NONE


def test_a_line_that_hangs_up_is_unreachable() -> None:
    with answering(lambda request: None) as port:
        sensor = a_sensor(port)
        with pytest.raises(UnreachableError):
            sensor.connect()


def test_nobody_listening_is_unreachable() -> None:
    with answering(lambda request: b"") as port:
        pass
    with pytest.raises(UnreachableError) as caught:
        a_sensor(port).connect()
    assert caught.value.effect is Effect.NONE


def test_a_temperature_below_zero_is_signed() -> None:
    assert decode_registers((0xFFF6, 700)).temperature_c == -0.1


@pytest.mark.parametrize("registers", [(2500, 1401), (0x7FFF, 700), (0x8000, 700)])
def test_values_that_no_liquid_has_are_refused(registers: tuple[int, int]) -> None:
    with pytest.raises(FrameError):
        decode_registers(registers)


def test_a_sensor_on_a_byte_line_is_refused() -> None:
    with pytest.raises(DefinitionError, match="RegisterTransport"):
        on_line(make_transport("tcp://127.0.0.1:502"))
