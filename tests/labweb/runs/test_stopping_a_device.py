"""One device is stopped by a person, and every promise of a dialog is kept by a test."""

from __future__ import annotations

import json
from typing import Any
from uuid import UUID

import pytest

from labweb.domain.errors import StateError
from labweb.domain.runs.host_journal.action_states import ActionState
from labweb.runs import services
from labweb.runs.models import DeviceHalt, Outbox, Run
from tests.builders import Bench
from tests.labweb.runs.hosts import Host, a_heating_run, states
from tests.labweb.runs.promises import KEPT, keeps, promised
from tests.labweb.runs.test_abort import cut_off, is_cancelled, shown, state, until_acting
from tests.labweb.web import call, signed_in


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


@pytest.fixture
def run(bench: Bench) -> Run:
    return a_heating_run(bench)


def stop_device(bench: Bench, who: str = "observer") -> dict[str, Any]:
    heater = bench.device("heater_1")
    answer = call(signed_in(bench.people[who]), "POST", f"/api/v1/devices/{heater.id}/stop", {})
    assert answer.status_code == 200, answer.content
    found: dict[str, Any] = json.loads(answer.content)
    return found


@keeps(
    "Halts this device now, whether anything acts on it or not.",
    "The runs that use it are paused and ask how to go on.",
)
def test_a_device_is_stopped_in_the_middle_of_an_action_and_its_run_asks_what_to_do(
    bench: Bench, host: Host, run: Run
) -> None:
    row = until_acting(host, "hold")
    assert stop_device(bench)["state"] == "asked"
    host.take()
    assert is_cancelled(host, row)
    cut_off(host, row)
    host.halt_owed()
    host.tell()
    found = shown(bench, run)
    assert found["state"] == "paused"
    assert [one["kind"] for one in found["pause_reasons"]] == ["device_stopped", "halted"]
    assert not found["can"]["resume"], "its hold was cut off, and its stirrer stands"
    assert DeviceHalt.objects.get().state == "halted"
    stirring = next(job for job in found["jobs"] if job["action"] == "stir")
    assert stirring["halted_by"] == "edge.device_stopped", "and not with another action"


@keeps(
    "Halts this device now, whether anything acts on it or not.",
)
def test_a_device_on_which_nothing_acts_is_stopped(bench: Bench, host: Host) -> None:
    assert stop_device(bench)["state"] == "asked"
    assert stop_device(bench)["id"] == str(DeviceHalt.objects.get().pk), "one wish is enough"
    host.take()
    host.halt_owed()
    host.tell()
    assert DeviceHalt.objects.get().state == "halted"


@keeps("It is a software stop. Use the red button on the bench in an emergency.")
def test_a_device_that_was_stopped_may_act_again_without_a_reset(bench: Bench, host: Host) -> None:
    stop_device(bench)
    run = a_heating_run(bench)
    services.dispatch_ready()
    assert "dispatched" not in states(run)
    host.take()
    host.halt_owed()
    host.tell()
    services.dispatch_ready()
    assert "dispatched" in states(run)


def test_what_waits_at_a_device_that_is_stopped_does_not_begin_afterwards(
    bench: Bench, host: Host, run: Run
) -> None:
    services.dispatch_ready()
    host.take()
    host.tell()
    assert len(host.disk.rows(ActionState.ACCEPTED)) == 1
    stop_device(bench)
    halt = Outbox.objects.get(kind="halt")
    Outbox.objects.filter(kind="cancel").delete()  # the word that calls it back is lost
    host.take()
    host.halt_owed()
    host.tell()
    assert halt.action_id == DeviceHalt.objects.get().pk
    assert host.disk.rows(ActionState.ACCEPTED) == []
    assert "held" in states(run)
    assert state(run) == "paused"


def test_a_device_that_no_host_serves_is_not_stopped_in_vain(bench: Bench) -> None:
    heater = bench.device("heater_1")
    heater.state = "suspended"
    heater.save()
    with pytest.raises(StateError, match="nothing here can halt it"):
        services.stop_device(heater.id, actor=bench.people["observer"])
    missing = f"/api/v1/devices/{UUID(int=7)}/stop"
    assert call(signed_in(bench.people["observer"]), "POST", missing, {}).status_code == 404


def test_every_promise_of_a_dialog_is_kept_by_a_test() -> None:
    assert set(KEPT) == promised()


def test_home_says_that_a_run_is_paused_because_the_lab_was_stopped(bench: Bench, run: Run) -> None:
    chemist = signed_in(bench.people["chemist"])
    assert call(chemist, "POST", "/api/v1/lab/stop", {}).status_code == 200
    assert state(run) == "paused"
    needs = json.loads(chemist.get("/api/v1/home").content)["needs_you"]
    told = [one["detail"] for one in needs if one["kind"] == "paused"]
    assert told == ["paused because the lab was stopped"]
