"""What an action leaves set, and when a reading says that it is gone."""

from __future__ import annotations

import pytest

from labweb.domain.enrollment.setpoint_readback import (
    SURE_S,
    TAKE_S,
    KeptReading,
    ReadbackVerdict,
    Seen,
    kept_by,
    look,
    setting_actions,
    unread_since_s,
)
from labweb.domain.runs.halts.halted_setpoints import sort_of

HEAT = KeptReading(status="temperature_setpoint_c", sort=ReadbackVerdict.SETPOINT, asked=60.0)
ON = KeptReading(status="is_controlling", sort=ReadbackVerdict.SWITCH, asked=True)
STIRS = KeptReading(status="speed_rpm", sort=ReadbackVerdict.MOTION, asked=400.0)


def seen_of(kept: KeptReading, *readings: tuple[float, object]) -> Seen:
    seen = Seen()
    for at_s, value in readings:
        seen = look(kept, seen, value, at_s)
    return seen


@pytest.mark.parametrize("found", [0.0, 20.0, 61.0, 80.0])
def test_a_setpoint_that_reads_another_number_for_a_while_is_gone(found: float) -> None:
    readings = [(0.0, 60.0), (5.0, found), (5.0 + SURE_S, found)]
    assert not seen_of(HEAT, *readings[:2]).is_lost, "one reading says nothing"
    assert seen_of(HEAT, *readings).is_lost
    assert not seen_of(HEAT, *readings, (20.0, 60.0)).is_lost


@pytest.mark.parametrize("rounded", [60.4, 59.5, 60.0])
def test_what_a_device_rounds_is_no_loss(rounded: float) -> None:
    assert not seen_of(HEAT, (0.0, rounded), (100.0, rounded), (200.0, rounded)).is_lost


def test_a_setpoint_that_was_never_read_back_is_gone_after_the_time_to_take_it() -> None:
    assert not seen_of(HEAT, (0.0, 0.0), (TAKE_S - 1, 0.0)).is_lost
    assert seen_of(HEAT, (0.0, 0.0), (TAKE_S, 0.0)).is_lost
    assert not seen_of(HEAT, (0.0, 0.0), (TAKE_S - 1, 60.0), (TAKE_S, 60.0)).is_lost


def test_a_switch_and_a_motion_have_to_be_seen_on_first() -> None:
    assert not seen_of(ON, (0.0, False), (1000.0, False)).is_lost
    assert not seen_of(STIRS, (0.0, 0.0), (1000.0, 0.0)).is_lost
    assert seen_of(ON, (0.0, True), (5.0, False), (15.0, False)).is_lost
    assert seen_of(STIRS, (0.0, 399.0), (5.0, 12.0), (15.0, 0.0)).is_lost


@pytest.mark.parametrize("nothing", [None, "off", float("nan"), [], {}])
def test_what_is_no_number_says_nothing(nothing: object) -> None:
    found = seen_of(HEAT, (0.0, 60.0), (5.0, nothing), (500.0, nothing))
    assert found == Seen(60.0)


def test_only_what_the_device_tells_is_read_back() -> None:
    args = {"speed_rpm": 300.0}
    assert [one.status for one in kept_by("stir", args, ["speed_rpm"])] == ["speed_rpm"]
    assert kept_by("stir", args, ["temperature_c"]) == ()
    assert kept_by("weigh", {}, ["mass_mg"]) == ()


@pytest.mark.parametrize("action", sorted(setting_actions() - {"deliver"}))
def test_what_is_read_back_is_what_a_halt_takes_away(action: str) -> None:
    assert sort_of(action) is not None


@pytest.mark.parametrize(
    ("read_s", "done_s", "pace", "since_s"),
    [
        ({"temperature_setpoint_c": 969.0}, 900.0, 1.0, 969.0),
        ({"temperature_setpoint_c": 971.0}, 900.0, 1.0, None),
        ({"temperature_setpoint_c": 969.0}, 971.0, 1.0, None),
        ({"temperature_setpoint_c": 969.0, "temperature_c": 999.0}, 900.0, 1.0, 969.0),
        ({}, 900.0, 1.0, 900.0),
        ({"temperature_setpoint_c": 998.1}, 900.0, 100.0, None),
        ({"temperature_setpoint_c": 998.0}, 900.0, 100.0, 998.0),
    ],
)
def test_what_stands_and_is_not_read_is_told_within_a_minute_of_lab_time(
    read_s: dict[str, float], done_s: float, pace: float, since_s: float | None
) -> None:
    heat = kept_by("heat_to", {"temperature_c": 60.0}, ["temperature_c", "temperature_setpoint_c"])
    assert unread_since_s(heat, read_s, done_s, 1000.0, pace) == since_s


def test_what_cannot_be_read_back_at_all_is_not_waited_for() -> None:
    assert unread_since_s([], {}, 0.0, 1000.0, 1.0) is None
