"""The TRS-02a by the frames of its manual, on a serial line and over TCP."""

from __future__ import annotations

from typing import cast

import pytest

from drivers.load import read_statuses
from drivers.sensors.simex_trs02a import SimexTrs02a, decode_registers, faults_of
from drivers.transports.modbus import RegisterTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import Effect, FrameError, RejectedError
from tests.drivers.rtu import line_of
from tests.drivers.wire import answering


def a_transducer(url: str) -> SimexTrs02a:
    return SimexTrs02a(cast("RegisterTransport", make_transport(url)), {})


def test_it_speaks_the_frames_of_the_manual() -> None:
    with line_of("simex_trs02a") as path:
        probe = a_transducer(f"modbus+serial://{path}?baud=9600&format=8N1&device=1")
        probe.connect()
        assert probe.measure().evidence == {"temperature_c": 19.3}
        with pytest.raises(RejectedError) as refusal:
            probe.measure()
        probe.close()
    assert "line to its probe is broken" in refusal.value.message
    assert refusal.value.effect is Effect.NONE
    assert refusal.value.context["last_temperature_c"] == 19.7


def replying(*answers: str) -> list[bytes]:
    return [bytes.fromhex(answer) for answer in answers]


def test_its_status_is_told_over_a_gateway_as_well() -> None:
    answers = replying("01 03 02 0076", "01 03 04 FFF6 0000")
    with answering(lambda q: q[:4] + (len(a := answers.pop(0))).to_bytes(2, "big") + a) as port:
        probe = a_transducer(f"modbus+tcp://127.0.0.1:{port}?device=1")
        probe.connect()
        assert read_statuses(probe) == {"temperature_c": -1.0}
        probe.close()


def test_another_device_at_its_address_is_refused() -> None:
    answer = bytes.fromhex("01 03 02 008B")
    with answering(lambda q: q[:4] + b"\0\x05" + answer) as port:
        probe = a_transducer(f"modbus+tcp://127.0.0.1:{port}?device=1")
        with pytest.raises(RejectedError, match="0x008B"):
            probe.connect()


@pytest.mark.parametrize(
    ("told", "text"),
    [
        (0x10, "water is in its housing"),
        (0x20, "its probe is damaged"),
        (0x40, "the probe is below -50 °C, or damaged"),
        (0x60, "its probe is short-circuited"),
        (0x80, "the probe is above 550 °C, or damaged"),
        (0xB0, "the line to its probe is broken; water is in its housing"),
        (0x01, "its status is 0x01"),
    ],
)
def test_every_status_is_a_refusal_that_says_what_is_wrong(told: int, text: str) -> None:
    assert faults_of(told) == text
    with pytest.raises(RejectedError, match="measures nothing"):
        decode_registers((200, told))


@pytest.mark.parametrize("raw", [0x8000, 5501, 0x10000 - 501])
def test_what_it_cannot_measure_is_no_reading(raw: int) -> None:
    with pytest.raises(FrameError):
        decode_registers((raw, 0))
