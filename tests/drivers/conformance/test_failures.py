"""What each driver says when its instrument or its wire fails: never that nothing happened.

The faults are put in force at the moment the acting frame leaves, so that what was moved and what
is answered part ways just there.
"""

from __future__ import annotations

import pytest

from drivers.load import read_status
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    UnreachableError,
)
from tests.drivers.conformance.conftest import Rig
from tests.drivers.conformance.instruments import CASES, Case, actions, usual_action

FOREVER_S = 100_000.0
FROM_MEMORY = {"chemputer_pump", "chemputer_valve", "masterflex_ls"}
"""Instruments that have no query: their drivers tell what was done last."""

every_driver = pytest.mark.parametrize("rig", CASES, indirect=True, ids=lambda case: case.id)
every_busy = pytest.mark.parametrize(
    "rig", [case for case in CASES if not case.no_busy], indirect=True, ids=lambda case: case.id
)
every_pump = pytest.mark.parametrize(
    "rig", [case for case in CASES if "pump" in case.role], indirect=True, ids=lambda case: case.id
)
every_teller = pytest.mark.parametrize(
    "rig",
    [case for case in CASES if case.module not in FROM_MEMORY],
    indirect=True,
    ids=lambda case: case.id,
)


def act(rig: Rig) -> None:
    name, arguments = usual_action(rig.case)
    rig.call(name, **arguments)


def first_status(case: Case) -> str:
    names = {
        "infusion_pump": "infused_ul",
        "continuous_pump": "is_running",
        "injection_valve": "position",
    }
    return names.get(case.role, "volume_ul" if case.role == "pump" else "port_index")


@every_driver
def test_a_silent_instrument_before_the_act_is_a_timeout_or_a_refusal(rig: Rig) -> None:
    starts = rig.starts()
    rig.inflict("no_answer", for_s=FOREVER_S)
    with pytest.raises(DeviceTimeoutError) as caught:
        act(rig)
    sent_the_act = any(rig.case.is_acting(frame) for frame in rig.sent)
    assert caught.value.effect is (Effect.UNKNOWN if sent_the_act else Effect.NONE)
    assert rig.starts() == starts


@every_driver
def test_an_act_whose_answer_is_lost_is_in_doubt_and_not_sent_again(rig: Rig) -> None:
    starts = len(rig.starts())
    rig.when_acting = lambda: rig.inflict("no_answer", executes=True, for_s=FOREVER_S)
    with pytest.raises(DeviceTimeoutError) as caught:
        act(rig)
    assert caught.value.effect is Effect.UNKNOWN
    assert len(rig.starts()) > starts
    assert sum(rig.case.is_acting(frame) for frame in rig.sent) == 1


@every_driver
def test_an_act_whose_answer_is_garbled_is_in_doubt(rig: Rig) -> None:
    rig.when_acting = lambda: rig.inflict("garbled", for_s=FOREVER_S)
    with pytest.raises((FrameError, DeviceTimeoutError)) as caught:
        act(rig)
    assert caught.value.effect is Effect.UNKNOWN


@pytest.mark.parametrize("fault", ["power_loss", "no_answer"])
@pytest.mark.parametrize(
    ("rig", "name"),
    [(case, name) for case in CASES for name in actions(case)],
    indirect=["rig"],
    ids=lambda value: value.id if isinstance(value, Case) else value,
)
def test_whatever_it_does_when_its_instrument_is_gone_nobody_knows_how_it_ended(
    rig: Rig, name: str, fault: str
) -> None:
    before, arguments = actions(rig.case)[name]
    for one, known in before:
        rig.call(one, **known)
    executes = {"executes": True} if fault == "no_answer" else {}
    rig.inflict(fault, in_act=True, for_s=FOREVER_S, **executes)
    with pytest.raises(DeviceError) as caught:
        rig.call(name, **arguments)
    assert rig.has_struck(fault)
    assert caught.value.effect is Effect.UNKNOWN


@every_pump
def test_power_that_comes_back_at_once_is_no_success(rig: Rig) -> None:
    rig.inflict("power_loss", in_act=True, for_s=0.001)
    with pytest.raises(DeviceError) as caught:
        act(rig)
    assert caught.value.effect is Effect.UNKNOWN


@every_driver
def test_a_wire_that_is_pulled_before_the_act_has_no_effect(rig: Rig) -> None:
    rig.transport.close()
    with pytest.raises(UnreachableError) as caught:
        act(rig)
    assert caught.value.effect is Effect.NONE


@every_busy
def test_a_busy_instrument_is_not_taken_for_one_that_acted(rig: Rig) -> None:
    rig.inflict("busy", for_s=FOREVER_S)
    with pytest.raises(DeviceError) as caught:
        act(rig)
    assert caught.value.code in {"device.rejected", "device.slow", "device.timeout"}


@every_teller
def test_a_status_that_cannot_be_read_has_no_effect(rig: Rig) -> None:
    rig.inflict("no_answer", for_s=FOREVER_S)
    with pytest.raises(DeviceTimeoutError) as caught:
        read_status(rig.driver, first_status(rig.case))
    assert caught.value.effect is Effect.NONE
