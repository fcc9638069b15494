"""Waiting for readings, and what a failure after the start is told as."""

import pytest

from drivers.transports.virtual import VirtualTransport
from drivers.virtual.timer import HostTimer
from drivers.waiting import (
    WantedReading,
    await_reading,
    await_true,
    once_started,
    refuse_between_steps,
    refuse_beyond,
    refuse_untaken,
    watch_reading,
)
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    PreconditionError,
    RejectedError,
)

WANTED = WantedReading(60.0, 1.0, "°C")


@pytest.fixture
def timer() -> HostTimer:
    return HostTimer(VirtualTransport("virtual:waiting"), {})


def test_a_reading_must_stay_near_for_its_settling_time(timer: HostTimer) -> None:
    readings = iter([50.0, 60.0, 62.0, *[60.0] * 1000])
    wanted = WantedReading(60.0, 1.0, "°C", 0.03)
    await_reading(timer, lambda: next(readings), wanted, limit_s=2.0, poll_s=0.005)
    assert len(list(readings)) < 999


def test_a_reading_that_never_comes_near_is_not_reached(timer: HostTimer) -> None:
    with pytest.raises(DeviceError) as caught:
        await_reading(timer, lambda: 20.0, WANTED, limit_s=0.02, poll_s=0.005)
    assert caught.value.code == "device.not_reached"


def test_a_reading_may_leave_for_the_grace_time_and_no_longer(timer: HostTimer) -> None:
    readings = iter([60.0, 70.0, 60.0, *[60.0] * 1000])
    watch_reading(
        timer, lambda: next(readings), WANTED, duration_s=0.05, poll_s=0.005, grace_s=0.03
    )
    with pytest.raises(DeviceError) as caught:
        watch_reading(timer, lambda: 70.0, WANTED, duration_s=5.0, poll_s=0.005, grace_s=0.03)
    assert caught.value.code == "device.not_held"


def test_what_never_comes_true_is_slow(timer: HostTimer) -> None:
    with pytest.raises(DeviceError) as caught:
        await_true(timer, lambda: False, "door shut", limit_s=0.02, poll_s=0.005)
    assert caught.value.code == "device.slow"


@pytest.mark.parametrize(
    ("error", "effect"),
    [
        (DeviceError("x", code="device.not_reached"), Effect.PARTIAL),
        (DeviceError("x", code="device.alarm"), Effect.PARTIAL),
        (RejectedError("x"), Effect.PARTIAL),
        (DeviceTimeoutError("x"), Effect.UNKNOWN),
        (DeviceTimeoutError("x", effect=Effect.NONE), Effect.UNKNOWN),
    ],
)
def test_a_failure_after_the_start_turns_it_off_and_is_never_without_effect(
    error: DeviceError, effect: Effect
) -> None:
    turned_off: list[bool] = []
    with (
        pytest.raises(DeviceError),
        once_started(lambda: turned_off.append(True), lambda: {"a": 1}),
    ):
        raise error
    assert turned_off == [True]
    assert error.effect is effect
    assert ("a" in error.context) is (effect is Effect.PARTIAL)


def test_what_nobody_can_describe_is_unknown() -> None:
    error = DeviceError("x", code="device.not_reached")
    with pytest.raises(DeviceError), once_started(lambda: None, None):
        raise error
    assert error.effect is Effect.UNKNOWN


def test_a_halt_that_fails_does_not_hide_the_first_failure() -> None:
    def fail() -> None:
        raise DeviceTimeoutError("no answer to the halt")

    error = DeviceError("too slow", code="device.slow")
    with pytest.raises(DeviceError) as caught, once_started(fail, dict):
        raise error
    assert caught.value is error
    assert error.effect is Effect.UNKNOWN
    assert error.context["not_turned_off"] == "no answer to the halt"


def test_limits_steps_and_setpoints_are_refused_and_never_moved() -> None:
    refuse_beyond("speed", 5.0, 0.0, 5.0)
    assert refuse_between_steps("voltage", 0.3, 0.1) == 3
    refuse_untaken("speed", 1.0, 1.05, resolution=0.1)
    with pytest.raises(PreconditionError):
        refuse_beyond("speed", 5.1, 0.0, 5.0)
    with pytest.raises(PreconditionError):
        refuse_between_steps("voltage", 0.35, 0.1)
    with pytest.raises(RejectedError):
        refuse_untaken("speed", 1.0, 1.2, resolution=0.1)


def quick(timer: HostTimer) -> HostTimer:
    timer.pace = 600.0
    return timer


def test_a_reading_that_comes_no_nearer_makes_no_progress(timer: HostTimer) -> None:
    with pytest.raises(DeviceError) as caught:
        await_reading(quick(timer), lambda: 30.0, WANTED, limit_s=1800.0, poll_s=1.0)
    assert caught.value.code == "device.no_progress"
    assert "comes no nearer for 150 s" in caught.value.message


def test_a_reading_that_was_on_its_way_and_goes_back_makes_no_progress(timer: HostTimer) -> None:
    driver = quick(timer)
    began_s = driver.now_s()

    def heated_and_off() -> float:
        passed_s = driver.now_s() - began_s
        return 20.0 + min(passed_s, 200.0) / 10 - max(0.0, passed_s - 200.0) / 10

    with pytest.raises(DeviceError) as caught:
        await_reading(driver, heated_and_off, WANTED, limit_s=7200.0, poll_s=1.0)
    assert caught.value.code == "device.no_progress"
    assert "goes away again" in caught.value.message
    assert driver.now_s() - began_s < 200.0 + 60.0 + 60.0


def test_a_reading_that_swings_past_the_goal_may_come_back(timer: HostTimer) -> None:
    driver = quick(timer)
    began_s = driver.now_s()

    def swinging() -> float:
        passed_s = driver.now_s() - began_s
        return 20.0 + min(passed_s, 500.0) / 10 - max(0.0, min(passed_s, 600.0) - 500.0) / 10

    wanted = WantedReading(60.0, 1.0, "°C", 30.0)
    assert await_reading(driver, swinging, wanted, limit_s=7200.0, poll_s=1.0) == 60.0


def test_a_slow_bath_that_comes_nearer_is_waited_for(timer: HostTimer) -> None:
    driver = quick(timer)
    began_s = driver.now_s()
    reading = await_reading(
        driver,
        lambda: 20.0 + (driver.now_s() - began_s) * 0.03,
        WANTED,
        limit_s=7200.0,
        poll_s=1.0,
    )
    assert reading == pytest.approx(59.0, abs=1.0)
