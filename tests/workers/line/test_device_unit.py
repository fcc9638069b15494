"""A device as its line holds it: a halt that was owed is delivered."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from labweb.domain.errors import UnreachableError
from tests.workers.bench import PumpProcess, a_device, installed
from workers.base.system_clock import HostClock
from workers.line.device_unit import DeviceUnit
from workers.line.line_process import make_units


@pytest.fixture
def unit(tmp_path: Path) -> Any:  # noqa: ANN401 - a generator of the unit
    pump = PumpProcess(tmp_path)
    device = a_device(pump.url)
    (found,) = make_units([device], HostClock(), installed()).values()
    yield found
    found.close()
    pump.end()


def unreachable() -> None:
    raise UnreachableError("the cable is out")


def test_a_halt_that_could_not_be_delivered_is_as_soon_as_the_device_is_reached(
    unit: DeviceUnit, monkeypatch: pytest.MonkeyPatch
) -> None:
    halts: list[str] = []
    with monkeypatch.context() as away:
        away.setattr(unit.driver, "halt", unreachable)
        unit.stop()
    monkeypatch.setattr(unit.driver, "halt", lambda: halts.append("halt"))
    unit.connect_if_due()
    assert unit.is_online
    assert halts == ["halt"]


def test_a_device_that_may_act_again_is_not_halted(
    unit: DeviceUnit, monkeypatch: pytest.MonkeyPatch
) -> None:
    halts: list[str] = []
    with monkeypatch.context() as away:
        away.setattr(unit.driver, "halt", unreachable)
        unit.stop()
    monkeypatch.setattr(unit.driver, "halt", lambda: halts.append("halt"))
    unit.clear_stop()
    unit.connect_if_due()
    assert unit.is_online
    assert halts == []
