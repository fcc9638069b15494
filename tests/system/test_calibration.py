"""A pump that moves three percent too little, from the balance to a volume that is right."""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.calibration.ph_buffers import buffer_ph
from labweb.domain.calibration.water_density import z_factor_ul_mg
from tests.builders import STARTER
from tests.system.stack import Stack, is_over, running

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]

ERROR_PCT = -3.0
WATER_C = 22.0
AROUND = {"water_c": WATER_C, "pressure_kpa": 101.3, "humidity_ratio": 0.5}


@pytest.fixture(scope="module")
def stack() -> Iterator[Stack]:
    """Start the starter lab with a syringe three percent too small, and with a worn electrode.

    Two of its bottles hold buffers of pH 6.87 and 4.00 at 22 °C.
    The water's density is the one that a balance in air shows at 22 °C, so that the mass on the
    simulated balance is the mass that a real one would tell.
    """
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    shutil.copytree(STARTER, folder / "starter")
    lab = json.loads((folder / "starter" / "lab.json").read_text())
    pump = next(device for device in lab["devices"] if device["key"] == "pump_1")
    pump["simulator"]["settings"]["volume_error_pct"] = ERROR_PCT
    water = next(one for one in lab["materials"] if one["key"] == "water")
    water["density_mg_ul"] = 1 / z_factor_ul_mg(WATER_C, AROUND["pressure_kpa"])
    water["ph"] = buffer_ph("phosphate", WATER_C)
    acid = next(one for one in lab["materials"] if one["key"].startswith("hydrochloric"))
    acid["ph"] = buffer_ph("phthalate", WATER_C)
    probe = next(device for device in lab["devices"] if device["key"] == "ph_1")
    probe["simulator"]["settings"] |= {"slope_pct": 95.0, "offset_ph": 0.15}
    lab["discovered"] = []
    (folder / "starter" / "lab.json").write_text(json.dumps(lab))
    try:
        with running(folder / "lab", lab=folder / "starter" / "lab.json") as found:
            yield found
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def device_id(stack: Stack, key: str) -> str:
    rows = stack.client().get("devices")["devices"]
    return str(next(row["id"] for row in rows if row["key"] == key))


def weighed_ul(stack: Stack, volume: str, **params: str) -> float:
    """Move water onto the balance and return what really came, by the bench's own count."""
    keys, before = stack.keys(), stack.volumes_ul()["flask_1"]
    wanted = {"source": keys["water"], "target": keys["flask_1"], "pump": keys["pump_1"]}
    run = stack.client().start_step("transfer", {**wanted, "volume": volume, **params})
    seen = stack.client().wait_for_run(run["id"], is_over)
    assert seen["state"] == "complete", seen["jobs"]
    return stack.volumes_ul()["flask_1"] - before


def refused(stack: Stack, accuracy: str) -> list[dict[str, Any]]:
    """Ask for a transfer that needs an accuracy and return the findings that refuse it."""
    keys = stack.keys()
    params = {
        "source": keys["water"], "target": keys["flask_1"], "pump": keys["pump_1"],
        "volume": "2 mL", "accuracy": accuracy,
    }  # fmt: skip
    step = {"id": "step", "kind": "transfer", "params": params, "position": {"x": 0, "y": 0}}
    document = {"schema": "labweb.workflow/1", "name": "Needs", "steps": [step], "edges": []}
    made = stack.client().call("POST", "workflows", {"name": "Needs", "document": document})
    path = f"workflows/{made['id']}/versions"
    version = stack.client().call("POST", path, {"note": ""})
    answer = stack.client().raw("POST", "runs", {"version_id": version["id"]})
    assert answer.status_code == 422, answer.text
    found: list[dict[str, Any]] = answer.json()["findings"]
    return found


def calibrated(stack: Stack) -> dict[str, Any]:
    """Calibrate pump 1 on the balance and return the result that waits for a person."""
    keys = stack.keys()
    order = {
        "source_id": keys["water"],
        "target_id": keys["flask_1"],
        "balance_id": device_id(stack, "balance_1"),
        "around": AROUND,
        "reference": {
            "name": "Balance XP204",
            "certificate": "D-K-15192-2026-11",
            "expanded": 0.4,
            "due_on": "2099-01-01",
        },
    }
    return measured(stack, f"devices/{device_id(stack, 'pump_1')}/calibrations", order)


def measured(stack: Stack, path: str, order: dict[str, Any]) -> dict[str, Any]:
    """Start a calibration and return its result once it waits for a person."""
    row: dict[str, Any] = stack.client().call("POST", path, order)
    seen = stack.client().wait_for_run(row["run"]["id"], is_over, 180)
    assert seen["state"] == "complete", seen["jobs"]
    deadline = time.monotonic() + 20
    while row["state"] == "measuring" and time.monotonic() < deadline:
        time.sleep(0.2)
        row = stack.client().get(f"calibrations/{row['id']}")
    return row


def test_a_pump_three_percent_off_is_right_to_half_a_percent_once_it_is_calibrated(
    stack: Stack,
) -> None:
    assert weighed_ul(stack, "2 mL") == pytest.approx(2000 * 0.97, rel=0.001)
    (finding,) = refused(stack, "1 %")
    assert finding["code"] == "calibration.missing"
    assert "Pump 1 has no calibration of volume, and the step needs 1 %" in finding["message"]

    row = calibrated(stack)
    assert row["state"] == "awaiting", row["findings"]
    assert row["findings"] == []
    assert row["result"]["gain"] == pytest.approx(0.97, abs=0.001)
    assert len(row["points"]) == 9

    own = stack.client().raw("POST", f"calibrations/{row['id']}/decision", {"is_accepted": True})
    assert own.status_code == 403
    accepted = stack.client("approver").call(
        "POST", f"calibrations/{row['id']}/decision", {"is_accepted": True, "comment": "fine"}
    )
    assert (accepted["state"], accepted["standing"]) == ("accepted", "in_force")

    before = stack.client().get("resources")["resources"]
    held = next(one["volume_nl"] for one in before if one["key"] == "flask_1")
    for volume_ul in (500, 2000, 5000):
        moved = weighed_ul(stack, f"{volume_ul} uL", accuracy="1 %")
        assert abs(moved - volume_ul) / volume_ul < 0.005
    after = stack.client().get("resources")["resources"]
    recorded = next(one["volume_nl"] for one in after if one["key"] == "flask_1")
    assert recorded - held == pytest.approx(7_500_000, abs=7_500)
    (finding,) = refused(stack, "0.01 %")
    assert finding["code"] == "calibration.too_uncertain"


def test_what_was_asked_and_what_was_sent_are_both_kept(stack: Stack) -> None:
    runs = stack.client().get("runs")["runs"]
    run = stack.client().run(runs[0]["id"])
    job = next(job for job in run["jobs"] if job["action"] == "aspirate")
    (kept,) = job["corrections"]
    assert kept["sent"] == job["args"]["volume_ul"] > kept["asked"]


def test_a_withdrawn_calibration_corrects_nothing_and_is_refused_by_name(stack: Stack) -> None:
    told = stack.client().get(f"devices/{device_id(stack, 'pump_1')}/calibrations")
    (volume,) = told["quantities"]
    row = stack.client("approver").call(
        "POST", f"calibrations/{volume['newest']}/withdraw", {"reason": "the syringe was changed"}
    )
    assert row["standing"] == "withdrawn"
    (finding,) = refused(stack, "1 %")
    assert finding["code"] == "calibration.withdrawn"
    assert weighed_ul(stack, "2 mL") == pytest.approx(2000 * 0.97, rel=0.001)


def read_ph(stack: Stack, source: str) -> tuple[dict[str, Any], float]:
    """Bring 5 mL to the probe and read it; return what was read, and what it really has."""
    keys = stack.keys()
    brought = {"source": keys[source], "target": keys["reactor_1"], "volume": "5 mL"}
    away = {"source": keys["reactor_1"], "target": keys["waste"], "volume": "5 mL"}
    run = stack.client().start_step("transfer", brought)
    stack.client().wait_for_run(run["id"], is_over)
    time.sleep(1.0)
    params = {"transmitter": keys["ph_1"], "accuracy": "0.1 pH"}
    run = stack.client().start_step("measure_ph", params)
    seen = stack.client().wait_for_run(run["id"], is_over)
    assert seen["state"] == "complete", seen["jobs"]
    with stack.instruments() as bench:
        really = float(bench.get("instruments/ph_1").json()["state"]["true_ph"])
    run = stack.client().start_step("transfer", away)
    stack.client().wait_for_run(run["id"], is_over)
    return seen["jobs"][0]["evidence"]["corrected"]["value_ph"], really


def test_a_worn_electrode_reads_right_once_it_is_calibrated_in_two_buffers(stack: Stack) -> None:
    keys = stack.keys()
    certificate = {"name": "Buffer", "certificate": "L-1", "expanded": 0.02, "due_on": "2099-01-01"}
    order = {
        "buffers": [
            {"source_id": keys[key], "standard": standard, "reference": certificate}
            for key, standard in (("water", "phosphate"), ("acid", "phthalate"))
        ],
        "vessel_id": keys["reactor_1"],
        "waste_id": keys["waste"],
        "pump_id": device_id(stack, "pump_1"),
        "volume_ul": 5000,
    }
    row = measured(stack, f"devices/{device_id(stack, 'ph_1')}/calibrations/ph", order)
    assert row["findings"] == []
    assert row["result"]["slope_pct"] == pytest.approx(95.0, abs=1.0)
    path = f"calibrations/{row['id']}/decision"
    stack.client("approver").call("POST", path, {"is_accepted": True})
    for source in ("water", "acid"):
        told, really = read_ph(stack, source)
        assert told["value"] == pytest.approx(really, abs=0.05)
        assert abs(told["raw"] - really) > 0.1
