"""Stop lab in the middle of a hold, on real processes: what it took away is asked about."""

from __future__ import annotations

from typing import Any

import pytest

from tests.system.stack import Stack, is_over

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]


def heater(stack: Stack) -> dict[str, Any]:
    rows = stack.client().get("resources")["resources"]
    found: dict[str, Any] = next(row for row in rows if row["key"] == "heater_1")
    data: dict[str, Any] = stack.client().get(f"resources/{found['id']}")["data"]
    return data


def job_of(run: dict[str, Any], action: str) -> dict[str, Any]:
    found: dict[str, Any] = next(job for job in run["jobs"] if job["action"] == action)
    return found


def recover(stack: Stack, run: dict[str, Any], action: str, choice: str) -> None:
    body = {"choice": choice, "note": "looked at the plate"}
    stack.client().call("POST", f"jobs/{job_of(run, action)['id']}/recover", body)


def test_a_run_goes_on_after_a_stop_only_with_the_stirrer_turning_again(stack: Stack) -> None:
    params = {
        "vessel": stack.keys()["reactor_1"],
        "temperature": "60 °C",
        "stir_speed": "400 rpm",
        # Ten seconds by the clock on the wall: the stop must arrive before the heater is off.
        "hold_for": "10 min",
    }
    run = stack.client().start_step("heat_chill", params)
    path = f"approvals/{run['approval']['id']}/decision"
    stack.client("approver").call("POST", path, {"is_approved": True, "comment": "warm only"})
    stack.client().wait_for_run(
        run["id"], lambda found: job_of(found, "hold")["state"] == "running", 90
    )
    assert heater(stack)["speed_setpoint_rpm"] == 400.0
    stack.client("observer").call("POST", "lab/stop", {})
    seen = stack.client().wait_for_run(
        run["id"], lambda found: is_over(found) and job_of(found, "stir")["halted_by"], 60
    )
    assert job_of(seen, "stir")["halted_by"] == job_of(seen, "heat_to")["halted_by"]
    assert heater(stack)["speed_setpoint_rpm"] is None
    assert heater(stack)["temperature_setpoint_c"] is None
    stack.client("admin").call("POST", "lab/reset", {"reason": "looked at the bench"})
    if seen["in_doubt_count"]:
        body = {"answer": "did_not", "despite_reading": True, "note": "it was cut short"}
        stack.client().call("POST", f"jobs/{job_of(seen, 'hold')['id']}/resolve", body)
        stack.client().wait_for_run(run["id"], lambda found: not found["in_doubt_count"])
    recover(stack, seen, "hold", "retry")
    refused = stack.client().raw("POST", f"runs/{run['id']}/resume", {})
    assert (refused.status_code, refused.json()["code"]) == (409, "run.halted")
    recover(stack, seen, "stir", "retry")
    recover(stack, seen, "heat_to", "retry")
    stack.client().call("POST", f"runs/{run['id']}/resume", {})
    ended = stack.client().wait_for_run(run["id"], lambda found: found["state"] == "complete", 90)
    assert job_of(ended, "stir")["state"] == "complete"
    turned = [act["detail"] for act in stack.actuations("heater_1") if act["verb"] == "motor"]
    assert turned.count({"setpoint_rpm": 400.0}) == 2, "set before the stop, and again after it"
