"""Every action that lasts, of every driver, aborted in the middle: what its instrument does then.

A stop comes from another thread, as from the one that watches a line. What is looked at is the
simulated instrument's own account of what it has begun and ended, and never what its driver says.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from drivers.load import read_spec
from labweb.domain.errors import DeviceError
from tests.drivers.conformance.analysers import CONDUCTIVITY, SENSORS
from tests.drivers.conformance.cases import EVERY
from tests.drivers.conformance.conftest import Rig, _start
from tests.drivers.conformance.deeds import NOT_MET, Deed, deeds_of
from tests.drivers.conformance.instruments import CASES, actions
from tests.drivers.conformance.placed_models import Bench, Case, Doing, do, running
from tests.fixtures.running import Process, until

SPEED = 5
"""Simulated seconds in a real one: an action lasts long enough to be met in the middle."""

MIDDLE_S = 8.0
"""So long it is waited for the instrument to begin."""

HALT_S = 3.0
"""Seconds from the stop until the instrument has to have ended all that it had begun."""

ENDS = {
    *("stop_control", "stop_driving", "stop_flow", "stop_heating", "stop_measuring"),
    *("stop_moving", "stop_program", "stop_pump", "stop_rotating", "stop_shaking"),
    *("stop_stirring", "stop_supply", "stop_test", "cancel_job", "close_drain"),
}
"""They end what goes on: cut off or not, it is over."""

AT_ONCE = {
    *("acknowledge_alarm", "collect", "confirm_drain_closed", "lock_plate", "select_position"),
    *("select_port", "tare", "unlock_plate", "weigh"),
}
"""One exchange: it is done when it is answered, or when a valve stands at its next place."""

ONLY_LOOK = {"await_end"}
"""They send nothing that begins anything."""

SENSING = {case.model for case in (*SENSORS, *CONDUCTIVITY)}
"""Their `measure` is one reading."""

UNSEEN = {"show_itself", "measure_open_circuit", "hold"}
"""They last, and begin nothing that the instrument would count: their time is looked at."""

STARTERS = {"start_test", "start_flow"}
"""They return while what they began goes on: one may have done so before the abort comes."""

CANNOT_STOP = {
    ("ika_rv10_digital", "raise_flask"): "its lift has no stop; it is up within a second",
    ("ika_rv10_digital", "lower_flask"): "its lift has no stop; it is down within a second",
    ("spectramax", "read_absorbance"): "a reading moves nothing outside of the reader and ends",
    ("spectramax", "open_drawer"): "its drawer has no stop, and goes to its end",
    ("spectramax", "close_drawer"): "its drawer has no stop, and goes to its end",
    ("cytomat", "initialize"): "its shovel has no stop: a plate must not be left half-way",
    ("cytomat", "store_plate"): "its shovel has no stop: a plate must not be left half-way",
    ("cytomat", "retrieve_plate"): "its shovel has no stop: a plate must not be left half-way",
    ("robotiq_2f85", "initialize"): "its activation has no stop, and ends within seconds",
}
"""What an instrument ends by itself whatever it is told, with the reason. Its maker gave it no word
for it, and the safe state of its driver says so."""

AT_REST = {"sila_controller": 22.0}
"""Controllers without a word for off, and the temperature at which they rest, in °C."""


def lasts(case: Case, name: str) -> bool:
    """Say whether an action goes on for a while, so that it can be aborted in the middle."""
    if name == "measure" and case.model in SENSING:
        return False
    return name not in ENDS | AT_ONCE | ONLY_LOOK


LASTING = [
    (case, deed) for case in EVERY for deed in deeds_of(case) if lasts(case, deed.name)
]  # fmt: skip


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with running(EVERY, speed=SPEED) as bench:
        yield bench


def test_no_action_of_any_driver_is_left_out() -> None:
    met = {(case.model, deed.name) for case, deed in LASTING}
    for case in EVERY:
        declared = {action.name for action in read_spec(case.dotted).actions}
        for name in declared - {name for model, name in NOT_MET if model == case.model}:
            assert ((case.model, name) in met) is lasts(case, name), (case.model, name)
    assert set(CANNOT_STOP) <= met
    specs = {name for case in CASES for name in actions(case)}
    assert specs - ENDS - AT_ONCE == set(STROKES) | {"initialize", "start_flow"}


@pytest.mark.parametrize(
    ("case", "deed"),
    LASTING,
    ids=lambda value: value.model if isinstance(value, Case) else value.name,
)
def test_an_abort_in_the_middle_leaves_nothing_of_it_going(
    bench: Bench, case: Case, deed: Deed
) -> None:
    with bench.connected(case) as device:
        until(lambda: not going(bench, case) or case.model in AT_REST, 20)
        for one in deed.first:
            prepare(device, one)
        if hasattr(device.config, "settle_s"):  # else it may be there before it is aborted
            msgspec.structs.force_setattr(device.config, "settle_s", 60.0)
        before = len(bench.acts(case))
        doing = Doing(device, deed.asked_of(device))
        begun_s = time.monotonic()
        while not doing.is_over and not going(bench, case, before):
            if time.monotonic() - begun_s > (MIDDLE_S if deed.name not in UNSEEN else 0.3):
                break
            time.sleep(0.01)
        is_goer = (case.model, deed.name) in CANNOT_STOP
        has_ended = doing.is_over
        goes_on = has_ended and doing.error is None and going(bench, case, before)
        assert is_goer or not has_ended or goes_on, f"it does not last: {doing.error}"
        device.stop()
        stopped_s = time.monotonic()
        if is_goer:
            until(lambda: doing.is_over, 20)
            until(lambda: not going(bench, case), 30)
            return
        if not has_ended and not (deed.name in STARTERS and doing.has_succeeded()):
            error = doing.failure()
            assert error.code == "device.stopped", error
        assert time.monotonic() - stopped_s < HALT_S
        if case.model in AT_REST:
            left = bench.acts(case)[-1]
            assert AT_REST[case.model] in left["detail"].values(), left
            return
        until(lambda: not going(bench, case), HALT_S)


def going(bench: Bench, case: Case, since: int = 0) -> list[str]:
    """Return what the instrument has begun and not ended, by its own account."""
    return [one["verb"] for one in bench.acts(case)[since:] if not one["ending"]]


def prepare(device: Any, act: tuple[str, dict[str, Any]]) -> None:  # noqa: ANN401 - any driver
    """Do what comes before; what is so already is refused."""
    for _ in range(3):
        try:
            do(device, act)
        except Exception:  # noqa: BLE001 - whatever it is, the test's own action tells
            continue
        return


# --- pumps and valves, on wires of their own ----------------------------------------

STROKES = ("aspirate", "dispense", "infuse", "withdraw", "deliver")


@pytest.fixture(scope="module")
def benches() -> Iterator[dict[str, tuple[Process, str]]]:
    """Start every pump and valve in real time, so that a stroke lasts."""
    process = Process(Path(tempfile.mkdtemp(prefix="lw", dir="/tmp")))
    try:
        urls = _start(process, list(CASES), "1")
        yield {case.id: (process, urls[case.id]) for case in CASES}
    finally:
        process.stop()
        shutil.rmtree(process.folder, ignore_errors=True)


@pytest.fixture(autouse=True)
def quick() -> None:
    """The drivers' own limits hold: these instruments run in real time."""


ONE_RATE = {"runze_sy01"}
"""Pumps whose rate is fixed by their motor."""

NO_STOP = {"chemputer_pump": "a move runs to its end, and its driver says so"}
"""Pumps whose protocol has no word for it, with the reason."""


def begun(rig: Rig) -> list[dict[str, Any]]:
    """List what the instrument physically started, in order."""
    return list(rig.process.get(f"/instruments/{rig.case.id}/actuations?since=0"))


def is_going(rig: Rig, since: int) -> bool:
    """Tell whether any of that goes on, of what came after so many."""
    return any(not one["ending"] for one in begun(rig)[since:])


@pytest.mark.parametrize(
    ("rig", "name"),
    [(case, name) for case in CASES for name in actions(case) if name not in ENDS | AT_ONCE],
    indirect=["rig"],
    ids=lambda value: value if isinstance(value, str) else value.id,
)
def test_a_stroke_that_is_aborted_is_not_finished(rig: Rig, name: str) -> None:
    before, arguments = actions(rig.case)[name]
    for one, known in before:
        rig.call(one, **known)
    full_ul = [rig.vessel_ul(index) for index, _ in enumerate(rig.case.ports)]
    if rig.case.role == "pump" and rig.case.module not in ONE_RATE:  # so that it lasts
        arguments = {key: min(value, 100.0) if "rate" in key else value
                     for key, value in arguments.items()}  # fmt: skip
    count = len(begun(rig))
    doing = Doing(rig.driver, (name, arguments))
    until(lambda: is_going(rig, count) or doing.is_over, 10)
    if rig.case.module in NO_STOP:
        with pytest.raises(DeviceError, match="runs to its end"):
            rig.driver.stop()
        until(lambda: doing.is_over, 20)
        rig.driver.clear_stop()
        return
    time.sleep(0.2)
    rig.driver.stop()
    until(lambda: doing.is_over, 3)
    until(lambda: not is_going(rig, count), 3)
    left_ul = [rig.vessel_ul(index) for index, _ in enumerate(rig.case.ports)]
    time.sleep(0.3)
    assert [rig.vessel_ul(index) for index, _ in enumerate(rig.case.ports)] == left_ul, "it flows"
    if name in STROKES:
        assert doing.error is not None, "the stroke was finished"
        assert doing.error.code == "device.stopped", doing.error
        moved = max(abs(a - b) for a, b in zip(full_ul, left_ul, strict=True))
        assert 0 < moved < arguments["volume_ul"], "its plunger stands in the middle"
    rig.driver.clear_stop()
