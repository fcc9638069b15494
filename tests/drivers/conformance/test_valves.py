"""What holds for every valve, each against its own instrument over its own wire."""

from __future__ import annotations

import threading
from contextlib import suppress

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import read_status
from labweb.domain.errors import DeviceError, Effect, PreconditionError
from tests.drivers.conformance.conftest import Rig
from tests.drivers.conformance.instruments import VALVES, of_role

every_valve = pytest.mark.parametrize("rig", VALVES, indirect=True, ids=lambda case: case.id)
every_injection_valve = pytest.mark.parametrize(
    "rig", of_role("injection_valve"), indirect=True, ids=lambda case: case.id
)


@every_valve
def test_a_valve_turns_to_each_of_its_ports_and_tells_it(rig: Rig) -> None:
    for port in range(rig.case.first_port, rig.case.last_port + 1):
        report = rig.call("select_port", port_index=port)
        assert report.evidence["port_index"] == port
        assert read_status(rig.driver, "port_index") == port


@every_valve
def test_a_port_that_is_not_there_sends_no_byte(rig: Rig) -> None:
    for port in (rig.case.first_port - 1, rig.case.last_port + 1):
        with pytest.raises(PreconditionError):
            rig.call("select_port", port_index=port)
    assert rig.sent == []


@every_valve
def test_the_same_port_may_be_selected_twice(rig: Rig) -> None:
    for _ in range(2):
        assert rig.call("select_port", port_index=2).evidence["port_index"] == 2


@every_valve
def test_a_valve_that_does_not_arrive_is_no_success(rig: Rig) -> None:
    rig.call("select_port", port_index=1)
    rig.inflict("valve_overload")
    with pytest.raises(DeviceError) as caught:
        rig.call("select_port", port_index=2)
    assert caught.value.effect is not Effect.NONE
    assert caught.value.context.get("port_index") != 2


@every_valve
def test_a_stopped_valve_is_not_turned(rig: Rig) -> None:
    rig.driver.stop()
    rig.sent.clear()
    with pytest.raises(DeviceStoppedError):
        rig.call("select_port", port_index=2)
    assert rig.sent == []


@every_valve
def test_a_stop_while_it_turns_is_never_no_effect(rig: Rig) -> None:
    rig.call("select_port", port_index=1)
    rig.when_acting = threading.Thread(target=_stop, args=(rig,)).start
    with pytest.raises(DeviceStoppedError) as caught:
        rig.call("select_port", port_index=2)
    assert caught.value.effect in {Effect.PARTIAL, Effect.UNKNOWN}


def _stop(rig: Rig) -> None:
    with suppress(DeviceError):  # some valves have no stop, and say so
        rig.driver.stop()


@every_injection_valve
def test_an_injection_valve_turns_both_ways_and_tells_it(rig: Rig) -> None:
    for position in ("inject", "load", "inject", "inject"):
        report = rig.call("select_position", position=position)
        assert report.evidence["position"] == position
        assert read_status(rig.driver, "position") == position


@every_injection_valve
def test_a_position_that_is_not_there_sends_no_byte(rig: Rig) -> None:
    with pytest.raises(PreconditionError):
        rig.call("select_position", position="flush")
    assert rig.sent == []


@every_injection_valve
def test_an_injection_valve_that_does_not_arrive_is_no_success(rig: Rig) -> None:
    rig.call("select_position", position="load")
    rig.inflict("valve_overload")
    with pytest.raises(DeviceError) as caught:
        rig.call("select_position", position="inject")
    assert caught.value.effect is not Effect.NONE
