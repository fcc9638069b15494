"""The LOOP against its recorded line and bytes of its published tables."""

import re

import pytest

from drivers.processing.lauda_loop import LaudaLoop, decode_number, decode_text, decode_whole
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.conftest import TRANSCRIPTS, Play

CHECKS = "> STATUS\\r\\n\n< 0\\r\\n\n> IN_PV_00\\r\\n\n< 22.00\\r\\n\n"
START = (
    "> OUT_SP_00_60.00\\r\\n\n< OK\\r\\n\n> IN_SP_00\\r\\n\n< 60.00\\r\\n\n"
    "> START\\r\\n\n< OK\\r\\n\n"
)
STOP = "> STOP\\r\\n\n< OK\\r\\n\n"
REPORT = "> IN_PV_00\\r\\n\n< 40.00\\r\\n\n> IN_SP_00\\r\\n\n< 60.00\\r\\n\n"


def thermostat(transport: object, **config: object) -> LaudaLoop:
    return LaudaLoop(transport, {"poll_s": 0.005, "settle_s": 0.0, **config})  # type: ignore[arg-type]


def reached_in_transcript() -> float:
    text = (TRANSCRIPTS / "lauda_loop.txt").read_text()
    found = re.search(r'"evidence":\{"temperature_c":([0-9.]+)', text)
    assert found is not None
    return float(found[1])


def test_the_recorded_line_heats_and_goes_to_standby(play: Play) -> None:
    device = thermostat(play("lauda_loop"))
    device.connect()
    assert device.temperature_c() == 22.0
    assert device.is_controlling() is False
    evidence = device.reach_temperature(30.0, 0.5).evidence
    assert evidence == {
        "temperature_c": reached_in_transcript(),
        "temperature_setpoint_c": 30.0,
    }
    assert abs(evidence["temperature_c"] - 30.0) <= 0.5
    assert device.is_controlling() is True
    assert set(device.stop_control().evidence) == set(evidence)
    assert device.is_controlling() is False


def test_another_type_is_refused(play: Play) -> None:
    with pytest.raises(RejectedError, match="MC") as caught:
        thermostat(play(text="> TYPE\\r\\n\n< MC\\r\\n\n")).connect()
    assert caught.value.effect is Effect.NONE


def test_a_fault_before_the_start_has_no_effect(play: Play) -> None:
    text = "> STATUS\\r\\n\n< -1\\r\\n\n> STAT\\r\\n\n< 100000\\r\\n\n"
    with pytest.raises(DeviceError, match="100000") as caught:
        thermostat(play(text=text)).reach_temperature(60.0, 1.0)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.NONE)


def test_a_fault_on_the_way_ends_the_action(play: Play) -> None:
    fault = "> STATUS\\r\\n\n< -1\\r\\n\n> STAT\\r\\n\n< 100000\\r\\n\n"
    text = CHECKS + START + fault + STOP + REPORT
    with pytest.raises(DeviceError) as caught:
        thermostat(play(text=text)).reach_temperature(60.0, 1.0)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.PARTIAL)
    assert caught.value.context["temperature_c"] == 40.0


def test_one_that_went_to_standby_by_itself_is_not_waited_for(play: Play) -> None:
    off = "> STATUS\\r\\n\n< 0\\r\\n\n> IN_MODE_02\\r\\n\n< 1\\r\\n\n"
    text = CHECKS + START + off + STOP + REPORT
    with pytest.raises(DeviceError, match="by itself"):
        thermostat(play(text=text)).reach_temperature(60.0, 1.0)


def test_a_setpoint_that_is_refused_starts_nothing(play: Play) -> None:
    refused = "> OUT_SP_00_60.00\\r\\n\n< ERR_6\\r\\n\n"
    with pytest.raises(RejectedError, match="value not allowed") as caught:
        thermostat(play(text=CHECKS + refused + STOP + REPORT)).reach_temperature(60.0, 1.0)
    assert caught.value.context["answer"] == "ERR_6"


def test_a_setpoint_that_was_not_taken_is_not_started(play: Play) -> None:
    other = "> OUT_SP_00_60.00\\r\\n\n< OK\\r\\n\n> IN_SP_00\\r\\n\n< 50.00\\r\\n\n"
    with pytest.raises(RejectedError, match="is 50 after writing 60"):
        thermostat(play(text=CHECKS + other + STOP + REPORT)).reach_temperature(60.0, 1.0)


def test_what_this_lab_does_not_allow_is_refused_before_a_byte(play: Play) -> None:
    with pytest.raises(PreconditionError) as caught:
        thermostat(play(text=""), max_temperature_c=50.0).reach_temperature(60.0, 1.0)
    assert caught.value.code == "device.limit"


def test_a_silent_thermostat_is_not_connected(play: Play, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.processing.lauda_loop.ANSWER_S", 0.05)
    with pytest.raises(DeviceTimeoutError) as caught:
        thermostat(play(text="> TYPE\\r\\n\n")).connect()
    assert caught.value.effect is Effect.NONE


@pytest.mark.parametrize(
    "frame", [b"22.0\r\n", b"22\r\n", b"2222.00\r\n", b"22.00", b"2\xb2.00\r\n", b"\r\n", b"OK\r\n"]
)
def test_other_numbers_are_a_frame_error(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_number(frame)


@pytest.mark.parametrize(
    "frame", [b"0.01\r\n", b"--1\r\n", b"on\r\n", b"1234\r\n", b"1.\r\n", b"1"]
)
def test_other_whole_numbers_are_a_frame_error(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_whole(frame)


def test_a_mode_that_the_manual_does_not_have_is_a_frame_error(play: Play) -> None:
    with pytest.raises(FrameError, match="none of"):
        thermostat(play(text="> IN_MODE_02\\r\\n\n< 2\\r\\n\n")).is_controlling()


def test_an_error_that_the_manual_does_not_have_is_told_as_it_came() -> None:
    with pytest.raises(RejectedError, match="ERR_77: an error that its manual does not explain"):
        decode_text(b"ERR_77\r\n")
