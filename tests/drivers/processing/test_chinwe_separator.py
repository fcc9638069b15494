"""The ChinWe separator against bytes of the published tables of its motors and its sensor."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.base import DeviceStoppedError
from drivers.processing.chinwe_separator import ChinweSeparator
from drivers.transports.replay import TranscriptMismatchError
from labweb.domain.errors import (
    DefinitionError,
    DeviceError,
    DeviceTimeoutError,
    Effect,
    PreconditionError,
    RejectedError,
)
from tests.drivers.chinwe import (
    A_QUARTER,
    AIR,
    AT_ZERO,
    BEYOND,
    CLOSED,
    CLOSES,
    CONFIG,
    ETHER,
    HALFWAY,
    LET_GO,
    NOT_KNOWN,
    NOT_MET,
    OPENS,
    READY,
    SHUT,
    STANDS,
    STRUCK,
    TAKEN,
    VERSIONS,
    WATER,
    ask,
    checked,
    confirmed,
    draining,
    flags,
    level,
    place,
    replayed,
    separator,
    speed,
)
from tests.drivers.conftest import Play


def drained(play: Play, text: str, volume_ul: float = 1000.0, **config: Any) -> Any:  # noqa: ANN401
    reading = config.pop("reading", "falls")
    return confirmed(play, text, **config).drain_lower_phase(volume_ul, reading)


def failed(play: Play, text: str, **config: Any) -> DeviceError:  # noqa: ANN401
    with pytest.raises(DeviceError) as caught:
        drained(play, text, **config)
    return caught.value


def test_it_knows_its_three_units(play: Play) -> None:
    text = ask("041f6b", f"04{VERSIONS}") + ask("051f6b", f"05{VERSIONS}")
    text += ask(checked("060300040001"), checked("0603020006"))
    separator(play(text=text)).connect()


@pytest.mark.parametrize("versions", ["1fc8786b", "1ff4796b"])
def test_a_motor_of_another_table_is_refused(play: Play, versions: str) -> None:
    with pytest.raises(RejectedError, match="firmware") as caught:
        separator(play(text=ask("041f6b", f"04{versions}"))).connect()
    assert caught.value.effect is Effect.NONE


def test_a_sensor_of_another_address_is_refused(play: Play) -> None:
    text = ask("041f6b", f"04{VERSIONS}") + ask("051f6b", f"05{VERSIONS}")
    text += ask(checked("060300040001"), checked("0603020007"))
    with pytest.raises(RejectedError, match="address is 7"):
        separator(play(text=text)).connect()


def test_its_statuses(play: Play) -> None:
    text = speed(300) + place("053601000000106b") + flags() + level(WATER) + level(AIR, 0)
    device = confirmed(play, text)
    assert device.speed_rpm() == 300.0
    assert device.is_drain_closed() is True
    assert device.neck_signal_count() == WATER
    assert device.has_liquid_at_neck() is False


@pytest.mark.parametrize("told", [A_QUARTER, HALFWAY, BEYOND])
def test_a_valve_away_from_its_zero_is_not_closed(play: Play, told: str) -> None:
    assert confirmed(play, place(told) + flags()).is_drain_closed() is False


def test_a_zero_that_is_told_once_proves_nothing(play: Play) -> None:
    flipped = ask("05366b", AT_ZERO) + place(A_QUARTER) + flags()
    assert confirmed(play, flipped).is_drain_closed() is False


def test_what_both_witnesses_say_has_moved(play: Play) -> None:
    text = READY + ask(OPENS, TAKEN) + draining([WATER] * 8) + level(ETHER) + CLOSED
    report = drained(play, text)
    assert report.moved_ul == report.evidence["by_time_ul"] == pytest.approx(1000.0, abs=400.0)
    assert report.resolution_ul == 800.0
    assert report.evidence["boundary"] is report.evidence["is_drain_closed"] is True
    assert report.evidence["first_neck_signal_count"] == WATER
    assert report.evidence["neck_signal_count"] == ETHER


def test_a_lower_phase_that_gives_less_ends_where_the_signal_rises(play: Play) -> None:
    ready = READY.replace(level(WATER), level(ETHER))
    text = ready + ask(OPENS, TAKEN) + draining([ETHER] * 8) + level(WATER) + CLOSED
    assert drained(play, text, reading="rises").evidence["boundary"] is True


def test_a_boundary_that_comes_too_early_proves_no_volume(play: Play) -> None:
    text = READY + ask(OPENS, TAKEN) + draining([WATER]) + level(ETHER) + CLOSED
    error = failed(play, text)
    assert (error.code, error.effect) == ("device.no_boundary", Effect.UNKNOWN)
    assert error.context["boundary"] is error.context["is_drain_closed"] is True
    assert "moved_ul" not in error.context


def test_a_boundary_that_never_comes_closes_the_drain_and_nobody_knows(play: Play) -> None:
    looks = level(WATER, mark=">?") + place(A_QUARTER, mark=">*")
    text = READY.replace(level(WATER), "") + looks + ask(OPENS, TAKEN) + looks
    text += ask(CLOSES, TAKEN) + SHUT
    error = failed(play, text)
    assert (error.code, error.effect) == ("device.no_boundary", Effect.UNKNOWN)
    assert error.context["boundary"] is False
    assert error.context["is_drain_closed"] is True
    assert error.context["by_time_ul"] > 1400.0


def test_a_vessel_that_runs_empty_is_closed_at_once(play: Play) -> None:
    ready = READY.replace(level(WATER), level(ETHER))
    text = ready + ask(OPENS, TAKEN) + draining([ETHER]) + level(AIR, 0) + CLOSED
    error = failed(play, text, reading="rises")
    assert (error.code, error.context["boundary"]) == ("device.no_boundary", False)
    assert error.context["has_liquid_at_neck"] is False


def test_air_at_the_neck_is_no_boundary_even_when_the_volume_agrees(play: Play) -> None:
    text = READY + ask(OPENS, TAKEN) + draining([WATER] * 8) + level(AIR, 0) + CLOSED
    error = failed(play, text)
    assert (error.code, error.effect) == ("device.no_boundary", Effect.UNKNOWN)
    assert error.context["boundary"] is False
    assert error.context["by_time_ul"] == pytest.approx(1000.0, abs=400.0)
    assert error.context["is_drain_closed"] is True


@pytest.mark.parametrize(
    ("signals", "reading"),
    [([WATER, 300], "falls"), ([499], "falls"), ([WATER], "rises"), ([ETHER, 250], "rises")],
)
def test_what_is_no_settled_lower_phase_is_not_drained(
    play: Play, signals: list[int], reading: str
) -> None:
    error = failed(
        play,
        speed(0) + SHUT + "".join(map(level, signals)),
        reading=reading,
        poll_s=0.005,
    )
    assert (error.code, error.effect) == ("device.not_settled", Effect.NONE)


def test_air_at_the_neck_is_not_drained(play: Play) -> None:
    error = failed(play, speed(0) + SHUT + level(AIR, 0), reading="rises")
    assert (error.code, error.effect) == ("device.not_settled", Effect.NONE)


def test_a_drain_that_is_not_shown_closed_is_not_opened(play: Play) -> None:
    away = place(HALFWAY) + flags() + place(HALFWAY)
    error = failed(play, speed(0) + away)
    assert (error.code, error.effect) == ("device.drain_open", Effect.NONE)
    with pytest.raises(RejectedError) as caught:
        confirmed(play, away).stir(300.0, 1.0)
    assert caught.value.effect is Effect.NONE


def test_a_stirrer_that_turns_is_not_drained_under(play: Play) -> None:
    error = failed(play, speed(30))
    assert (error.code, error.effect) == ("device.rejected", Effect.NONE)


def test_a_valve_that_has_stalled_before_is_not_opened(play: Play) -> None:
    text = READY.removesuffix(flags()) + STRUCK
    error = failed(play, text, poll_s=0.005)
    assert (error.code, error.effect) == ("device.alarm", Effect.NONE)


def test_a_valve_that_is_not_enabled_is_enabled_first(play: Play) -> None:
    enabled = LET_GO + ask("05f3ab01006b", "05f3026b")
    text = READY.removesuffix(flags()) + enabled + ask(OPENS, NOT_MET)
    error = failed(play, text, poll_s=0.005)
    assert (error.code, error.effect) == ("device.rejected", Effect.NONE)


@pytest.mark.parametrize("answer", [NOT_MET, NOT_KNOWN])
def test_an_opening_that_is_refused_moved_nothing(play: Play, answer: str) -> None:
    error = failed(play, READY + ask(OPENS, answer), poll_s=0.005)
    assert error.effect is Effect.NONE


@pytest.mark.parametrize("answer", ["", "05fd026c", "04fd026b"])
def test_an_opening_of_which_nothing_is_known_is_closed(play: Play, answer: str) -> None:
    error = failed(play, READY + ask(OPENS, answer) + CLOSED, poll_s=0.005)
    assert error.effect is Effect.UNKNOWN
    assert error.context["is_drain_closed"] is True


def test_a_mistake_of_the_driver_leaves_no_drain_open(play: Play) -> None:
    text = READY + ask(OPENS, TAKEN) + CLOSED  # it knows no look at the sensor
    device = confirmed(play, text, poll_s=0.005)
    with pytest.raises(TranscriptMismatchError):
        device.drain_lower_phase(1000.0, "falls")
    assert bytes.fromhex(CLOSES) in replayed(device).sent


def test_a_valve_that_does_not_open_all_the_way_is_closed(play: Play) -> None:
    looks = level(WATER, mark=">?") + place(HALFWAY, mark=">*")
    text = READY.replace(level(WATER), "") + ask(OPENS, TAKEN) + looks + ask(CLOSES, TAKEN)
    error = failed(play, text + SHUT, poll_s=0.01)
    assert (error.code, error.effect) == ("device.not_reached", Effect.UNKNOWN)
    assert error.context["is_drain_closed"] is True


@pytest.mark.parametrize("answer", [checked("068302"), checked("0603040001026c")[:-2] + "00"])
def test_a_sensor_that_fails_in_mid_drain_closes_the_drain(play: Play, answer: str) -> None:
    lost = ask(checked("060300010002"), answer)
    error = failed(play, READY + ask(OPENS, TAKEN) + lost + CLOSED, poll_s=0.005)
    assert error.effect is Effect.UNKNOWN
    assert error.context["is_drain_closed"] is True


def test_a_drain_that_does_not_close_is_said_out_loud(play: Play) -> None:
    stuck = ask(CLOSES, TAKEN) + place(HALFWAY, mark=">*")
    text = READY + ask(OPENS, TAKEN) + draining([WATER] * 8) + level(ETHER)
    error = failed(play, text + place(A_QUARTER) * 2 + stuck)
    assert (error.code, error.effect) == ("device.drain_open", Effect.UNKNOWN)
    assert "may be open" in error.message
    assert error.context["valve_count"] == 0x2000
    assert error.context["is_drain_closed"] is None


def test_a_valve_that_stalls_on_its_way_back_is_freed_and_sent_again(play: Play) -> None:
    freed = ask(CLOSES, NOT_MET) + STRUCK + ask("050e526b", "050e026b")
    freed += ask("05f3ab01006b", "05f3026b") + ask(CLOSES, TAKEN)
    report = confirmed(play, place(HALFWAY) + freed + SHUT + place(AT_ZERO)).close_drain()
    assert report.evidence == {"is_drain_closed": True, "valve_count": 0}


def test_a_valve_that_took_the_command_to_open_and_never_tells_it_may_be_open(play: Play) -> None:
    looks = level(WATER, mark=">?") + place(AT_ZERO, mark=">*")
    text = READY.replace(level(WATER), "") + ask(OPENS, TAKEN) + looks + ask(CLOSES, TAKEN)
    error = failed(play, text + SHUT, poll_s=0.01)
    assert (error.code, error.effect) == ("device.drain_open", Effect.UNKNOWN)
    assert error.context["is_drain_closed"] is None


def test_a_stop_before_the_drain_opens_moved_nothing(play: Play) -> None:
    device = confirmed(play, place(AT_ZERO) + ask(CLOSES, TAKEN) + STANDS + SHUT)
    device.stop()
    with pytest.raises(DeviceStoppedError) as caught:
        device.drain_lower_phase(1000.0, "falls")
    assert caught.value.effect is Effect.NONE


@pytest.mark.parametrize(
    ("volume_ul", "config", "code"),
    [
        (250_001.0, {}, "device.limit"),
        (200.0, {}, "device.volume_too_small"),
        (200_000.0, {"drain_rate_ul_s": 50.0}, "device.rate_out_of_range"),
    ],
)
def test_a_volume_that_cannot_be_told_is_refused_before_a_byte(
    play: Play, volume_ul: float, config: dict[str, Any], code: str
) -> None:
    with pytest.raises(PreconditionError) as caught:
        drained(play, "", volume_ul, **config)
    assert caught.value.code == code


@pytest.mark.parametrize(
    "wrong",
    [
        {"threshold_count": 500},
        {"low_count": 300},
        {"valve_index": 4},
        {"sensor_index": 5},
        {"tolerance_ratio": 0.0},
    ],
)
def test_settings_that_make_no_sense_are_refused(play: Play, wrong: dict[str, Any]) -> None:
    with pytest.raises(DefinitionError):
        separator(play(text=""), **wrong)


@pytest.mark.parametrize("name", ["low_count", "threshold_count", "high_count", "drain_rate_ul_s"])
def test_what_the_lab_has_to_measure_has_no_default(play: Play, name: str) -> None:
    known = {key: value for key, value in CONFIG.items() if key != name}
    with pytest.raises(DefinitionError, match=name):
        ChinweSeparator(play(text=""), known)


def test_a_halt_stops_the_stirrer_even_where_the_valve_is_silent(play: Play) -> None:
    device = confirmed(play, place(AT_ZERO) + ask(CLOSES) + STANDS)
    with pytest.raises(DeviceTimeoutError):
        device.halt()
