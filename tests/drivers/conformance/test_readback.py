"""What an action has set is read back at every driver that can tell, and its loss ends it."""

import time
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest

from drivers.base import Driver
from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import scan
from drivers.load import call_action, read_spec, read_status
from drivers.readback import CANNOT_TELL
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.enrollment.setpoint_readback import (
    KeptReading,
    ReadbackVerdict,
    Seen,
    kept_by,
    look,
    setting_actions,
)
from labweb.domain.errors import DeviceError, Effect, LabError
from tests.drivers.conformance.cases import EVERY
from tests.drivers.conformance.deeds import Deed, deeds_of
from tests.drivers.conformance.placed_models import SPEED, Action, Bench, Case, Doing, do, running
from tests.fixtures.running import until

MINUTE_S = 60.0
"""Lab time within which a loss is told."""

LATE_S = 15.0
"""Real time that a busy machine may add."""

TOLD = {
    *("device.setpoint_lost", "device.alarm"),
    *("device.timeout", "device.unreachable", "device.frame"),
}
"""How it is told: read back, by the device itself, or by a link that broke with it."""

STAYS = {"eurotherm": "it comes up with the set-point that it had, and goes on controlling"}
"""Instruments that lose nothing when they restart."""

SLOW = {"settle_s": 500.0, "reach_limit_s": 5000.0, "heat_limit_s": 5000.0, "poll_s": 0.5}
"""Settings with which an action waits until the test has had its say."""


@cache
def _spec(module: str) -> DriverSpec:
    return read_spec(module)


def statuses_of(case: Case) -> frozenset[str]:
    return frozenset(one.name for one in _spec(case.dotted).statuses)


def kept_of(case: Case, act: Action) -> tuple[KeptReading, ...]:
    return kept_by(act[0], act[1], statuses_of(case))


@cache
def setting_deeds() -> list[tuple[Case, Deed]]:
    return [
        (case, deed)
        for case in EVERY
        for deed in deeds_of(case)
        if deed.name in setting_actions() and kept_of(case, (deed.name, _whole(deed)))
    ]


def _whole(deed: Deed) -> dict[str, Any]:
    return {"temperature_c": 40.0, **deed.act[1]}


def lasting_deeds() -> list[tuple[Case, Deed]]:
    """Return what waits by settings of its driver, or by a duration that is asked for."""
    return [
        (case, deed)
        for case, deed in setting_deeds()
        if deed.name
        in {"heat_to", "hold", "ramp_to", "reach_temperature", "heat_bath_to", "evacuate_to"}
        and case.model not in STAYS
    ]


def _id(value: object) -> str:
    return value.model if isinstance(value, Case) else value.name if isinstance(value, Deed) else ""


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    models = {case.model: case for case, _ in setting_deeds()}
    with running(list(models.values())) as one:
        yield one


def slowly(case: Case) -> dict[str, float]:
    known = {one.name for one in _spec(case.dotted).config}
    return {name: value for name, value in SLOW.items() if name in known}


def begun(bench: Bench, case: Case, device: Driver[Any, Any], deed: Deed) -> Doing:
    """Let the action begin, and wait until the device has what it sets."""
    name, arguments = deed.asked_of(device)
    if name == "hold":
        arguments = {**arguments, "duration_s": 5000.0}
    kept = kept_by(name, arguments, statuses_of(case))
    doing = Doing(device, (name, arguments))
    until(lambda: doing.is_over or all(one.fits(read_status(device, one.status)) for one in kept))
    time.sleep(12.0 / SPEED)  # two looks
    assert not doing.is_over, doing.error
    return doing


@pytest.mark.parametrize(("case", "deed"), lasting_deeds(), ids=_id)
def test_a_device_that_restarts_while_it_is_waited_for_is_told_within_a_minute(
    bench: Bench, case: Case, deed: Deed
) -> None:
    with bench.connected(case) as quick:
        for act in deed.first:
            do(quick, act)
        quick.close()
        device = bench.driver(case, **slowly(case))
        device.pace = SPEED
        device.connect()
        try:
            doing = begun(bench, case, device, deed)
            at_s = time.monotonic()
            bench.inflict(case, "restart")
            error = doing.failure()
            assert time.monotonic() - at_s < MINUTE_S / SPEED + LATE_S
        finally:
            device.close()
        assert error.code in TOLD, error
        assert error.effect is not Effect.NONE


@pytest.mark.parametrize(
    ("case", "deed"),
    [one for one in setting_deeds() if "duration_s" not in one[1].act[1] or one[1].name == "hold"],
    ids=_id,
)
def test_what_stands_after_an_action_raises_no_alarm_until_its_device_restarts(
    bench: Bench, case: Case, deed: Deed
) -> None:
    with bench.connected(case) as device:
        for act in deed.first:
            do(device, act)
        name, arguments = deed.asked_of(device)
        do(device, (name, arguments))
        device.pace = SPEED
        kept = kept_by(name, arguments, statuses_of(case))
        seen = dict.fromkeys(kept, Seen())
        until_s = device.now_s() + 3 * MINUTE_S
        while device.now_s() < until_s:
            seen = looked(device, seen)
            assert not any(one.is_lost for one in seen.values()), seen
        assert any(one.base is not None for one in seen.values()), "nothing was read back"
        if case.model in STAYS:
            return
        bench.inflict(case, "restart")
        at_s, device_s = time.monotonic(), device.now_s()
        while not any(one.is_lost for one in seen.values()):
            assert time.monotonic() - at_s < MINUTE_S / SPEED + LATE_S, (device_s, seen)
            seen = looked(device, seen)


def looked(device: Driver[Any, Any], seen: dict[KeptReading, Seen]) -> dict[KeptReading, Seen]:
    """Read everything once, as a host does between two steps."""
    found = {}
    for kept, before in seen.items():
        try:
            value = read_status(device, kept.status)
        except DeviceError:  # its link broke as it restarted: a host connects again
            found[kept] = before
            device.close()
            until(lambda: _reconnects(device))
            continue
        found[kept] = look(kept, before, value, device.now_s())
    device.rest(2.0)
    return found


def _reconnects(device: Driver[Any, Any]) -> bool:
    try:
        device.connect()
    except LabError:
        return False
    return True


@pytest.mark.parametrize(
    ("model", "act", "knob", "code"),
    [
        (
            "ika_rct_digital",
            ("heat_to", {"temperature_c": 60.0, "tolerance_c": 1.0}),
            {"temperature_c": 80.0},
            "device.setpoint_lost",
        ),
        (
            "ika_ret_control_visc",
            ("heat_to", {"temperature_c": 60.0, "tolerance_c": 1.0}),
            {"temperature_c": 62.0},
            "device.setpoint_lost",
        ),
        (
            "heidolph_hei_connect",
            ("heat_to", {"temperature_c": 60.0, "tolerance_c": 1.0}),
            {"temperature_c": 20.0},
            "device.setpoint_lost",
        ),
        (
            "huber_pb",
            ("reach_temperature", {"temperature_c": 60.0, "tolerance_c": 1.0}),
            {"temperature_c": 30.0},
            "device.setpoint_lost",
        ),
    ],
)
def test_a_knob_that_somebody_turns_meanwhile_is_told_within_a_minute(
    bench: Bench, model: str, act: Action, knob: dict[str, float], code: str
) -> None:
    case = next(one for one in EVERY if one.model == model)
    with bench.connected(case, **slowly(case)) as device:
        device.pace = SPEED
        doing = begun(bench, case, device, Deed(act=act))
        at_s = time.monotonic()
        bench.inflict(case, "knob", **knob)
        error = doing.failure()
        assert time.monotonic() - at_s < MINUTE_S / SPEED + LATE_S
        assert error.code == code
        assert error.effect is Effect.PARTIAL
        assert error.context["asked"] != error.context["found"]


def test_a_hotplate_that_reboots_while_it_heats_ends_the_action_and_says_what_it_reads(
    bench: Bench,
) -> None:
    case = next(one for one in EVERY if one.model == "ika_rct_digital")
    with bench.connected(case, **slowly(case)) as plate:
        plate.pace = SPEED
        doing = begun(bench, case, plate, next(deeds_of(case)))
        bench.inflict(case, "restart")
        error = doing.failure()
    assert error.code == "device.setpoint_lost"
    assert error.effect is Effect.PARTIAL
    assert "the temperature set-point reads 0 °C; 40 °C was set" in error.message
    assert "temperature_c" in error.context


@pytest.mark.parametrize(
    "model", ["ika_rct_digital", "ika_ret_control_visc", "ika_microstar_75", "bioshake"]
)
def test_a_stirrer_that_stalls_after_its_step_reads_as_stalled(bench: Bench, model: str) -> None:
    case = next(one for one in EVERY if one.model == model)
    name, arguments = next(one.act for one in deeds_of(case) if one.name in {"stir", "shake"})
    with bench.connected(case) as device:
        device.pace = SPEED
        call_action(device, name, arguments)
        kept = kept_by(name, arguments, statuses_of(case))
        seen = looked(device, dict.fromkeys(kept, Seen()))
        bench.inflict(case, "stall")
        at_s = time.monotonic()
        while not any(one.is_lost for one in seen.values()):
            assert time.monotonic() - at_s < MINUTE_S / SPEED + LATE_S
            seen = looked(device, seen)
    assert {one.sort for one, found in seen.items() if found.is_lost} == {ReadbackVerdict.MOTION}


def test_every_driver_that_leaves_something_set_can_be_read_back_or_says_why_not() -> None:
    silent = set()
    for spec in scan(PACKAGE).drivers:
        setting = [one for one in spec.actions if one.name in setting_actions()]
        statuses = [one.name for one in spec.statuses]
        asked = {one.name: 1.0 for action in setting for one in action.parameters}
        if setting and not any(kept_by(one.name, asked, statuses) for one in setting):
            silent.add(spec.module)
    assert silent <= set(CANNOT_TELL)
