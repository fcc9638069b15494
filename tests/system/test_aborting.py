"""Abort a run while it heats, on real processes: the simulated hotplate itself is looked at."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest

from tests.system.stack import Stack

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

GIVEN = (Path(__file__).parents[2] / "../shared/data/8_reports/abort_heat.json").resolve()
HALTED_WITHIN_S = 10.0


def approved(stack: Stack, document: dict[str, Any]) -> dict[str, Any]:
    """Start a workflow of one step, with the approval that heating to 60 °C or above needs."""
    step = document["steps"][0]
    params = {**step["params"], "vessel": stack.keys()["reactor_1"]}
    run = stack.client().start_step(step["kind"], params)
    if run["approval"] is not None:
        path = f"approvals/{run['approval']['id']}/decision"
        stack.client("approver").call("POST", path, {"is_approved": True, "comment": "warm only"})
    return run


def heating(temperature: str, hold_for: str) -> dict[str, Any]:
    params = {"temperature": temperature, "stir_speed": "300 rpm", "hold_for": hold_for}
    return {"steps": [{"kind": "heat_chill", "params": params}]}


def going(stack: Stack) -> set[str]:
    """Return what the hotplate does now, by its own account."""
    with stack.instruments() as control:
        found = control.get("instruments/heater_1/actuations?since=0").json()
    return {one["verb"] for one in found if not one["ending"]}


def acting(run: dict[str, Any], action: str) -> bool:
    return any(job["action"] == action and job["state"] == "running" for job in run["jobs"])


def aborted(stack: Stack, run: dict[str, Any]) -> dict[str, Any]:
    """Abort a run that heats, and return it once it has ended; the plate must be off by then."""
    assert going(stack) >= {"heater"}
    began_s = time.monotonic()
    stack.client().call("POST", f"runs/{run['id']}/abort", {"reason": "it smells"})
    while going(stack):
        assert time.monotonic() - began_s < HALTED_WITHIN_S, going(stack)
        time.sleep(0.05)
    ended = stack.client().wait_for_run(run["id"], lambda one: one["state"] == "aborted", 30)
    assert [halt["state"] for halt in ended["halts"]] == ["halted"]
    assert not ended["in_doubt_count"]
    return ended


def cut_off(run: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = next(job for job in run["jobs"] if job["state"] == "aborted")
    return found


def test_an_abort_on_the_way_to_a_temperature_turns_heater_and_stirrer_off(stack: Stack) -> None:
    run = approved(stack, heating("55 °C", "60 min"))
    stack.client().wait_for_run(run["id"], lambda one: acting(one, "heat_to"), 60)
    job = cut_off(aborted(stack, run))
    assert (job["action"], job["code"]) == ("heat_to", "device.stopped")
    assert "temperature_c" in job["evidence"]["report"]["evidence"], "how far it came"


def test_an_abort_during_a_hold_of_an_hour_ends_within_seconds_and_the_next_run_goes_on(
    stack: Stack,
) -> None:
    run = approved(stack, heating("40 °C", "60 min"))
    stack.client().wait_for_run(run["id"], lambda one: acting(one, "hold"), 120)
    behind = approved(stack, heating("41 °C", "1 s"))
    job = cut_off(aborted(stack, run))
    assert "held_s" in job["evidence"]["report"]["evidence"], "how far it came"
    stack.client().wait_for_run(behind["id"], lambda one: one["state"] == "complete", 120)


@pytest.mark.skipif(not GIVEN.is_file(), reason="the given workflow lies outside of the checkout")
def test_the_given_workflow_that_heats_is_aborted_while_it_does(stack: Stack) -> None:
    run = approved(stack, json.loads(GIVEN.read_text(encoding="utf-8")))
    stack.client().wait_for_run(run["id"], lambda one: acting(one, "heat_to"), 60)
    aborted(stack, run)


def test_one_device_is_stopped_while_it_heats_and_its_run_asks_how_to_go_on(stack: Stack) -> None:
    run = approved(stack, heating("60 °C", "60 min"))
    stack.client().wait_for_run(run["id"], lambda one: acting(one, "heat_to"), 60)
    devices = stack.client().get("devices")["devices"]
    heater = next(one for one in devices if one["key"] == "heater_1")
    began_s = time.monotonic()
    stack.client("observer").call("POST", f"devices/{heater['id']}/stop", {})
    while going(stack):
        assert time.monotonic() - began_s < HALTED_WITHIN_S, going(stack)
        time.sleep(0.05)
    stack.client().wait_for_run(run["id"], lambda one: one["state"] == "paused", 30)
    stack.client().call("POST", f"runs/{run['id']}/abort", {"reason": "done with it"})
    stack.client().wait_for_run(run["id"], lambda one: one["state"] == "aborted", 30)


def test_a_temperature_that_never_comes_is_waited_for_until_an_abort(stack: Stack) -> None:
    """Waiting for hours ends within seconds, leaves nothing in doubt, and the next run goes on."""
    vessel = stack.keys()["reactor_1"]
    never = {"vessel": vessel, "lowest": "90 °C", "highest": "95 °C"}
    run = stack.client().start_step("await_temperature", never)
    stack.client().wait_for_run(
        run["id"], lambda one: any(job["state"] == "completing" for job in one["jobs"]), 60
    )
    stack.client().call("POST", f"runs/{run['id']}/abort", {"reason": "it stays cold"})
    ended = stack.client().wait_for_run(run["id"], lambda one: one["state"] == "aborted", 15)
    assert (cut_off(ended)["code"], ended["in_doubt_count"]) == ("vessel.between_temperatures", 0)
    here = {"vessel": vessel, "lowest": "0 °C", "highest": "80 °C"}
    again = stack.client().start_step("await_temperature", here)
    stack.client().wait_for_run(again["id"], lambda one: one["state"] == "complete", 60)
