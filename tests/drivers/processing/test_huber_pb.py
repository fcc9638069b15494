"""The PB command set against the vectors of its manual."""

import json

import pytest

from drivers.processing.huber_pb import (
    HuberPb,
    decode_reply,
    decode_temperature,
    encode_read,
    encode_write,
)
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError
from tests.corpus import INSTRUMENTS, NO_INSTRUMENTS
from tests.drivers.conftest import Play

VECTORS = INSTRUMENTS / "huber_pb_vectors.json"

CHECKS = (
    "> {M30****\\r\\n\n< {S30C504\\r\\n\n".replace("C504", "F060")
    + "> {M31****\\r\\n\n< {S314E20\\r\\n\n> {M0A****\\r\\n\n< {S0A0000\\r\\n\n"
    + "> {M01****\\r\\n\n< {S0107D0\\r\\n\n"
)
START = "> {M130000\\r\\n\n< {S130000\\r\\n\n> {M001770\\r\\n\n< {S001770\\r\\n\n"
OFF = "> {M140000\\r\\n\n< {S140000\\r\\n\n> {M160000\\r\\n\n< {S160000\\r\\n\n"
REPORT = "> {M01****\\r\\n\n< {S0107D0\\r\\n\n> {M00****\\r\\n\n< {S001770\\r\\n\n"


def thermostat(transport: object, **config: object) -> HuberPb:
    return HuberPb(transport, {"poll_s": 0.005, "settle_s": 0.0, "start_s": 0.0, **config})  # type: ignore[arg-type]


@pytest.mark.skipif(not VECTORS.is_file(), reason=NO_INSTRUMENTS)
def test_the_vectors_of_the_manual() -> None:
    checked = 0
    for vector in json.loads(VECTORS.read_text())["pb"]:
        request = vector["req"].replace("\\r\\n", "\r\n").encode()
        answer = vector["resp"].replace("\\r\\n", "\r\n").encode()
        if len(request) != 10:
            continue  # the 32-bit form, which the driver does not use
        address = int(request[2:4], 16)
        value = decode_reply(answer, address)
        if b"*" in request:
            assert encode_read(address) == request
        else:
            assert encode_write(address, value) == request
        checked += 1
    assert checked == 8


def test_it_heats_under_control_and_proves_every_write(play: Play) -> None:
    text = (
        CHECKS + START + "> {M140001\\r\\n\n< {S140001\\r\\n\n> {M0A****\\r\\n\n< {S0A0001\\r\\n\n"
        "> {M01****\\r\\n\n< {S011770\\r\\n\n" + REPORT
    )
    assert thermostat(play(text=text)).reach_temperature(60.0, 1.0).evidence == {
        "temperature_c": 20.0,
        "temperature_setpoint_c": 60.0,
    }


def test_a_setpoint_that_the_thermostat_limits_turns_it_off(play: Play) -> None:
    text = CHECKS + START.replace("S001770", "S001388") + OFF + REPORT
    transport = play(text=text)
    with pytest.raises(RejectedError) as caught:
        thermostat(transport).reach_temperature(60.0, 1.0)
    assert caught.value.effect is Effect.PARTIAL
    assert b"{M140001\r\n" not in transport.sent


def test_an_error_while_it_heats_turns_it_off(play: Play) -> None:
    text = (
        CHECKS + START + "> {M140001\\r\\n\n< {S140001\\r\\n\n> {M0A****\\r\\n\n< {S0A0101\\r\\n\n"
        "> {M05****\\r\\n\n< {S05FFF0\\r\\n\n" + OFF + REPORT
    )
    with pytest.raises(DeviceError, match="-16") as caught:
        thermostat(play(text=text)).reach_temperature(60.0, 1.0)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.PARTIAL)


@pytest.mark.parametrize("raw", [-15100, 0x7FFF])
def test_no_sensor_is_no_temperature(raw: int) -> None:
    with pytest.raises(DeviceError, match="no temperature"):
        decode_temperature(raw)


@pytest.mark.parametrize(
    "frame", [b"{S0107D0\n", b"{S0207D0\r\n", b"{M0107D0\r\n", b"{S01\xb07D0\r\n", b"{S01****\r\n"]
)
def test_a_garbled_answer_is_a_frame_error(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_reply(frame, 1)
