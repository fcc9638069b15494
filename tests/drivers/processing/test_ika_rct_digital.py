"""The RCT digital against bytes of its published command table."""

from __future__ import annotations

import threading

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import read_statuses
from drivers.processing import ika_rct_digital as module
from drivers.processing._namur import decode_value
from drivers.processing.ika_rct_digital import IkaRctDigital
from drivers.transports.base import Direction
from drivers.transports.replay import ReplayTransport
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    PreconditionError,
    RejectedError,
)
from tests.drivers.conftest import Play

SET_60 = "> OUT_SP_1 60\\r\\n\n> IN_SP_1\\r\\n\n< 60.0 1\\r\\n\n> START_1\\r\\n\n"
SET_300 = "> OUT_SP_4 300\\r\\n\n> IN_SP_4\\r\\n\n< 300.0 4\\r\\n\n> START_4\\r\\n\n"


def plate(transport: ReplayTransport, **config: object) -> IkaRctDigital:
    return IkaRctDigital(transport, {"poll_s": 0.005, "settle_s": 0.05, **config})


def test_heating_returns_once_the_reading_has_stayed_within_tolerance(play: Play) -> None:
    device = plate(play("rct_heat"))
    device.connect()
    report = device.heat_to(60.0, 1.0)
    assert report.evidence["temperature_c"] == 59.8
    assert report.evidence["temperature_setpoint_c"] == 60.0
    assert report.evidence["duration_s"] >= 0.05
    assert report.moved_ul is None


def test_another_model_is_refused(play: Play) -> None:
    device = plate(play(text="> IN_NAME\\r\\n\n< IKARET\\r\\n\n"))
    with pytest.raises(RejectedError, match="IKARET") as caught:
        device.connect()
    assert caught.value.effect is Effect.NONE


def test_stirring_waits_for_the_speed_and_stopping_for_the_stand(play: Play) -> None:
    device = plate(play("rct_stir"))
    assert device.stir(300.0).evidence == {"speed_rpm": 299.0}
    assert device.stop_stirring().evidence == {"speed_rpm": 0.0}


def test_every_status_asks_its_own_channel(play: Play) -> None:
    assert read_statuses(plate(play("rct_statuses"))) == {
        "temperature_c": 25.3,
        "plate_temperature_c": 31.0,
        "temperature_setpoint_c": 60.0,
        "speed_rpm": 298.0,
        "speed_setpoint_rpm": 300.0,
    }


def test_a_setpoint_the_device_did_not_take_starts_nothing(play: Play) -> None:
    transport = play(text="> OUT_SP_1 60\\r\\n\n> IN_SP_1\\r\\n\n< 25.0 1\\r\\n\n")
    with pytest.raises(RejectedError) as caught:
        plate(transport).heat_to(60.0, 1.0)
    assert caught.value.effect is Effect.NONE
    assert b"START_1\r\n" not in transport.sent


def test_a_temperature_above_the_limit_of_this_lab_is_not_sent(play: Play) -> None:
    transport = play(text="")
    with pytest.raises(PreconditionError):
        plate(transport, max_temperature_c=80.0).heat_to(81.0, 1.0)
    assert transport.sent == []


def test_silence_while_heating_is_unknown_and_turns_the_heater_off(play: Play) -> None:
    transport = play(text=SET_60 + "> IN_PV_1\\r\\n\n> STOP_1\\r\\n\n")
    with pytest.raises(DeviceTimeoutError) as caught:
        plate(transport).heat_to(60.0, 1.0)
    assert caught.value.effect is Effect.UNKNOWN


def test_silence_before_the_start_has_no_effect(play: Play) -> None:
    transport = play(text="> OUT_SP_1 60\\r\\n\n> IN_SP_1\\r\\n\n")
    with pytest.raises(DeviceTimeoutError) as caught:
        plate(transport).heat_to(60.0, 1.0)
    assert caught.value.effect is Effect.NONE


def test_a_temperature_not_reached_in_time_turns_the_heater_off(play: Play) -> None:
    text = (
        SET_60
        + ">* IN_PV_1\\r\\n\n< 30.0 1\\r\\n\n> STOP_1\\r\\n\n> IN_PV_1\\r\\n\n< 30.0 1\\r\\n\n"
    )
    device = plate(play(text=text), heat_limit_s=0.1)
    with pytest.raises(DeviceError) as caught:
        device.heat_to(60.0, 1.0)
    assert caught.value.code == "device.not_reached"
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["temperature_c"] == 30.0


def test_a_stop_while_heating_turns_heater_and_motor_off(play: Play) -> None:
    text = SET_60 + ">* IN_PV_1\\r\\n\n< 30.0 1\\r\\n\n>? STOP_1\\r\\n\n>? STOP_4\\r\\n\n"
    transport = play(text=text)
    device = plate(transport)
    is_heating = threading.Event()

    def watch(direction: Direction, data: bytes) -> None:
        if data.startswith(b"30.0") and direction == "in":
            is_heating.set()

    def stop() -> None:
        is_heating.wait(5)
        device.stop()

    transport.observer = watch
    stopper = threading.Thread(target=stop)
    stopper.start()
    with pytest.raises(DeviceStoppedError) as caught:
        device.heat_to(60.0, 1.0)
    stopper.join(5)
    assert {b"STOP_1\r\n", b"STOP_4\r\n"} <= set(transport.sent)
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["temperature_c"] == 30.0


def test_a_stopped_plate_may_still_be_turned_off(play: Play) -> None:
    text = (
        ">? STOP_1\\r\\n\n>? STOP_4\\r\\n\n"
        ">? IN_PV_1\\r\\n\n< 30.0 1\\r\\n\n>? IN_PV_4\\r\\n\n< 0.0 4\\r\\n\n"
    )
    device = plate(play(text=text))
    device.stop()
    assert device.stop_heating().evidence == {"temperature_c": 30.0}
    assert device.stop_stirring().evidence == {"speed_rpm": 0.0}
    with pytest.raises(DeviceStoppedError):
        device.stir(300.0)


def test_holding_needs_the_temperature_to_be_reached_first(play: Play) -> None:
    transport = play(text="> IN_PV_1\\r\\n\n< 25.0 1\\r\\n\n")
    with pytest.raises(PreconditionError, match="bring it there first"):
        plate(transport).hold(1.0, 60.0, 1.0)


def test_holding_watches_for_the_whole_time(play: Play) -> None:
    text = (
        "> IN_PV_1\\r\\n\n< 60.1 1\\r\\n\n"
        + SET_60
        + ">* IN_PV_1\\r\\n\n< 60.2 1\\r\\n\n> IN_SP_1\\r\\n\n< 60.0 1\\r\\n\n"
    )
    report = plate(play(text=text)).hold(0.1, 60.0, 1.0)
    assert report.evidence["duration_s"] >= 0.1


def test_a_held_temperature_that_runs_away_turns_the_heater_off(play: Play) -> None:
    text = (
        "> IN_PV_1\\r\\n\n< 60.1 1\\r\\n\n"
        + SET_60
        + ">* IN_PV_1\\r\\n\n< 75.0 1\\r\\n\n> STOP_1\\r\\n\n> IN_PV_1\\r\\n\n< 75.0 1\\r\\n\n"
    )
    with pytest.raises(DeviceError) as caught:
        plate(play(text=text), grace_s=0.02).hold(30.0, 60.0, 1.0)
    assert caught.value.code == "device.not_held"
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["held_s"] < 30


def test_a_motor_that_does_not_turn_is_switched_off(
    play: Play, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SPEED_LIMIT_S", 0.02)
    text = (
        SET_300
        + ">* IN_PV_4\\r\\n\n< 0.0 4\\r\\n\n> STOP_4\\r\\n\n> IN_PV_4\\r\\n\n< 0.0 4\\r\\n\n"
    )
    with pytest.raises(DeviceError) as caught:
        plate(play(text=text)).stir(300.0)
    assert caught.value.effect is Effect.PARTIAL
    assert caught.value.context["speed_rpm"] == 0.0


@pytest.mark.parametrize(
    "frame", [b"25.3 2\r\n", b"25.3\r\n", b"warm 1\r\n", b"\xff5.3 1\r\n", b"nan 1\r\n", b""]
)
def test_a_garbled_value_is_a_frame_error(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode_value(frame, 1)
