"""Only approved source is loaded, and only fitting arguments are sent."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from drivers.load import call_action, load_driver, read_spec, read_status, read_statuses
from drivers.transports.base import Transport
from drivers.transports.urls import make_transport
from labweb.domain.errors import (
    ConformanceError,
    DefinitionError,
    DeviceTimeoutError,
    Effect,
    NotFoundError,
    PreconditionError,
)
from tests.drivers.conftest import Play

PUMP = "drivers.connectors.tricontinent_c3000"
TIMER = "drivers.virtual.timer"


@pytest.fixture
def virtual() -> Iterator[Transport]:
    transport = make_transport("virtual:timer")
    yield transport
    transport.close()


def test_an_approved_driver_is_built_and_carries_its_spec(play: Play) -> None:
    spec = read_spec(PUMP)
    pump = load_driver(PUMP, spec.class_name, spec.digest, play(text=""), {"syringe_ul": 5000})
    assert pump.spec == spec
    assert type(pump).__name__ == "TricontinentC3000"


def test_source_with_another_digest_is_never_loaded(virtual: Transport) -> None:
    with pytest.raises(ConformanceError) as caught:
        load_driver(TIMER, "HostTimer", "0" * 64, virtual, {})
    assert caught.value.code == "driver.digest"


def test_another_class_of_the_module_is_never_loaded(virtual: Transport) -> None:
    with pytest.raises(ConformanceError):
        load_driver(TIMER, "Config", read_spec(TIMER).digest, virtual, {})


@pytest.mark.parametrize(
    "module",
    [
        "os",
        "drivers.base",
        "drivers.load",
        "drivers.catalog.__main__",
        "drivers.sensors.nothing",
        "drivers...etc",
        "labweb.domain.errors",
        "drivers/sensors/seeed_ph",
        "drivers.sensors.seeed_ph\n",
        "",
    ],
)
def test_only_driver_modules_of_this_package_can_be_named(module: str, virtual: Transport) -> None:
    with pytest.raises(ConformanceError):
        load_driver(module, "HostTimer", "0" * 64, virtual, {})


def test_settings_that_do_not_fit_are_listed(play: Play) -> None:
    spec = read_spec(PUMP)
    with pytest.raises(DefinitionError) as caught:
        load_driver(PUMP, spec.class_name, spec.digest, play(text=""), {"ports_count": 99})
    assert {finding.code for finding in caught.value.findings} == {
        "driver.argument_missing",
        "driver.argument_range",
    }


def test_an_action_with_arguments_that_do_not_fit_sends_nothing(play: Play) -> None:
    spec = read_spec(PUMP)
    transport = play(text="")
    pump = load_driver(PUMP, spec.class_name, spec.digest, transport, {"syringe_ul": 5000.0})
    for arguments in ({}, {"volume_ul": "5 mL", "rate_ul_s": 1.0}, {"volume_ul": 1e9}):
        with pytest.raises(PreconditionError):
            call_action(pump, "aspirate", arguments)
    assert transport.sent == []


@pytest.mark.parametrize("name", ["connect", "stop", "volume_ul", "_act", "__init__", "nothing"])
def test_only_marked_actions_can_be_called(play: Play, name: str) -> None:
    spec = read_spec(PUMP)
    pump = load_driver(PUMP, spec.class_name, spec.digest, play(text=""), {"syringe_ul": 5000.0})
    with pytest.raises(NotFoundError):
        call_action(pump, name, {})


def test_statuses_are_read_by_name_and_a_silent_one_has_no_effect(play: Play) -> None:
    spec = read_spec(PUMP)
    transport = play(
        text="> /1?19\\r\n< /0`1\\x03\\r\\n\n"
        "> /1?\\r\n< /0`600\\x03\\r\\n\n> /1?6\\r\n< /0`3\\x03\\r\\n\n> /1?6\\r\n"
    )
    pump = load_driver(PUMP, spec.class_name, spec.digest, transport, {"syringe_ul": 5000.0})
    assert read_statuses(pump) == {"is_initialized": True, "volume_ul": 1000.0, "port_index": 3}
    with pytest.raises(DeviceTimeoutError) as caught:
        read_status(pump, "port_index")
    assert caught.value.effect is Effect.NONE
    with pytest.raises(NotFoundError):
        read_status(pump, "aspirate")


def test_an_action_returns_its_report(virtual: Transport) -> None:
    timer = load_driver(TIMER, "HostTimer", read_spec(TIMER).digest, virtual, {})
    timer.connect()
    assert call_action(timer, "wait", {"duration_s": 0}).evidence["waited_s"] < 1
    assert virtual.is_open
    timer.close()
    assert not virtual.is_open
