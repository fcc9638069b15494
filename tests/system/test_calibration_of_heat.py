"""A heater whose probe is three percent and two kelvin off, beside a thermometer that is not."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.builders import STARTER
from tests.system.stack import Stack, is_over, running
from tests.system.test_calibration import device_id, measured

pytestmark = [pytest.mark.slow, pytest.mark.timeout(500)]

SLOPE_PCT, OFFSET_C = 103.0, 2.0
SET_POINTS_C = (28.0, 40.0, 52.0)
SPAN_C = SET_POINTS_C[-1] - SET_POINTS_C[0]
SETTLE_S = 240
"""By the instruments' clock, which goes SPEED times as fast as the wall's."""


@pytest.fixture(scope="module")
def stack() -> Iterator[Stack]:
    """Start the starter lab with a hotplate whose probe in the vessel is off."""
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    shutil.copytree(STARTER, folder / "starter")
    lab = json.loads((folder / "starter" / "lab.json").read_text())
    heater = next(one for one in lab["devices"] if one["key"] == "heater_1")
    heater["simulator"]["settings"] |= {"slope_pct": SLOPE_PCT, "offset_c": OFFSET_C}
    lab["discovered"] = []
    (folder / "starter" / "lab.json").write_text(json.dumps(lab))
    try:
        with running(folder / "lab", lab=folder / "starter" / "lab.json") as found:
            yield found
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def an_order(stack: Stack, **changes: Any) -> dict[str, Any]:  # noqa: ANN401
    reference = {"name": "pH 1", "certificate": "K-1", "expanded": 0.05, "due_on": "2099-01-01"}
    return {
        "vessel_id": stack.keys()["reactor_1"],
        "thermometer_id": device_id(stack, "ph_1"),
        "reference": reference,
        "set_points_c": list(SET_POINTS_C),
        "settle_s": SETTLE_S,
        "repeats": 2,
        "stir_speed_rpm": 300,
        "tolerance": 0.5,
        **changes,
    }


def path_of(stack: Stack) -> str:
    return f"devices/{device_id(stack, 'heater_1')}/calibrations/temperature"


def heated(stack: Stack, temperature: str, **params: str) -> tuple[dict[str, Any], float]:
    """Hold the reactor at a temperature; return the job, and what the liquid really has."""
    wanted = {"vessel": stack.keys()["reactor_1"], "temperature": temperature}
    run = stack.client().start_step("heat_chill", wanted | params)
    seen = stack.client().wait_for_run(run["id"], is_over, 120)
    assert seen["state"] == "complete", seen["jobs"]
    hold = {
        "duration_s": SETTLE_S,
        "temperature_c": float(temperature.split()[0]),
        "tolerance_c": 2,
    }
    kept = {"device": stack.keys()["heater_1"], "action": "hold", "args": hold}
    run = stack.client().start_step("device_action", kept)
    assert stack.client().wait_for_run(run["id"], is_over, 60)["state"] == "complete"
    with stack.instruments() as bench:
        really = float(bench.get("instruments/ph_1").json()["state"]["temperature_c"])
    job = next(job for job in seen["jobs"] if job["action"] == "heat_to")
    return job, really


def test_a_heater_three_percent_and_two_kelvin_off_is_right_once_it_is_calibrated(
    stack: Stack,
) -> None:
    client, keys = stack.client(), stack.keys()
    empty = client.raw("POST", path_of(stack), an_order(stack))
    assert (empty.status_code, empty.json()["findings"][0]["code"]) == (
        412, "calibration.vessel_empty",
    )  # fmt: skip
    filled = {"source": keys["water"], "target": keys["reactor_1"], "volume": "20 mL"}
    run = client.start_step("transfer", filled)
    assert client.wait_for_run(run["id"], is_over, 120)["state"] == "complete"
    _, really = heated(stack, "45 °C")
    assert abs(really - 45) > 2.5

    row = measured(stack, path_of(stack), an_order(stack))
    assert (row["state"], row["findings"]) == ("awaiting", [])
    assert row["result"]["gain"] == pytest.approx(100 / SLOPE_PCT, abs=0.01)
    accepted = stack.client("approver").call(
        "POST", f"calibrations/{row['id']}/decision", {"is_accepted": True, "comment": "fine"}
    )
    assert (accepted["state"], accepted["standing"]) == ("accepted", "in_force")

    for asked_c in (34, 46):
        job, really = heated(stack, f"{asked_c} °C", accuracy="0.5 K")
        assert abs(really - asked_c) < 0.005 * SPAN_C
        (kept,) = job["corrections"]
        assert kept["asked"] == asked_c
        assert kept["sent"] == job["args"]["temperature_c"] > asked_c + 2.5
        told = f"OUT_SP_1 {round(kept['sent'], 1):g}\r\n".encode()
        assert told in b"".join(data for way, data in stack.tap("line2.tty") if way == "in")


def test_beyond_what_was_compared_nothing_is_sent(stack: Stack) -> None:
    params = {"vessel": stack.keys()["reactor_1"], "temperature": "58 °C"}
    step = {"id": "s", "kind": "heat_chill", "params": params, "position": {"x": 0, "y": 0}}
    document = {"schema": "labweb.workflow/1", "name": "Hot", "steps": [step], "edges": []}
    made = stack.client().call("POST", "workflows", {"name": "Hot", "document": document})
    version = stack.client().call("POST", f"workflows/{made['id']}/versions", {"note": ""})
    answer = stack.client().raw("POST", "runs", {"version_id": version["id"]})
    assert answer.status_code == 422
    assert [one["code"] for one in answer.json()["findings"]] == ["calibration.out_of_range"]


def test_a_thermometer_whose_certificate_has_ended_calibrates_nothing(stack: Stack) -> None:
    ended = an_order(stack)["reference"] | {"due_on": "2020-01-01"}
    answer = stack.client().raw("POST", path_of(stack), an_order(stack, reference=ended))
    assert answer.status_code == 412
    assert [one["code"] for one in answer.json()["findings"]] == ["calibration.reference_expired"]
