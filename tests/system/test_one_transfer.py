"""One pump transfer from REST through the final processes to the bytes and back.

Every fault of the crash matrix strikes real processes here; the simulated pump counts its
own strokes outside the system under test.
"""

from __future__ import annotations

from typing import Any

import pytest

from tests.system.stack import Stack, is_over

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

WATER = "Move 5 mL of water"


def strokes(stack: Stack) -> list[str]:
    """Return the strokes of pump 1 so far, oldest first."""
    acts = stack.actuations("pump_1")
    return [act["verb"] for act in acts if act["verb"] in {"aspirate", "dispense"}]


def volumes_nl(stack: Stack) -> dict[str, int]:
    """Return what the record says each vessel holds."""
    rows = stack.client().get("resources")["resources"]
    return {row["key"]: row["volume_nl"] for row in rows if row["holds_liquid"]}


def test_a_transfer_reaches_the_instrument_and_the_ledger(stack: Stack) -> None:
    before, acts = volumes_nl(stack), len(strokes(stack))
    run = stack.client().start(WATER)
    run = stack.client().wait_for_run(run["id"], is_over)
    assert run["state"] == "complete"
    assert {job["verification"] for job in run["jobs"]} == {"device"}
    after = volumes_nl(stack)
    assert after["reactor_1"] - before["reactor_1"] == 5_000_000
    assert before["water"] - after["water"] == 5_000_000
    assert strokes(stack)[acts:] == ["aspirate", "dispense"]
    assert stack.volumes_ul()["reactor_1"] == pytest.approx(after["reactor_1"] / 1000, abs=1.0)
    sent = b"".join(data for direction, data in stack.tap("line0.tty") if direction == "in")
    assert b"A3000R\r" in sent
    assert b"A0R\r" in sent


def test_the_driver_action_ran_inside_a_celery_worker(stack: Stack) -> None:
    run = stack.client().get("runs")["runs"][0]
    lines = stack.client().get(f"runs/{run['id']}/log")["lines"]
    pids = {line["body"]["pid"] for line in lines if line["kind"] == "started"}
    assert len(pids) == 1
    log = (stack.data / "logs" / "edge-host.log").read_text()
    assert f"line0.tty runs as process {pids.pop()}" in log


def test_a_muted_pump_never_reads_as_done(stack: Stack) -> None:
    with stack.silent("pump_1"):
        run = stack.client().start(WATER)
        seen = stack.client().wait_for_run(run["id"], is_over, 90)
    assert seen["state"] == "paused"
    assert not any(job["state"] == "complete" for job in seen["jobs"])
    for job in seen["jobs"]:
        if job["state"] == "in_doubt":
            body = {
                "answer": "did_not",
                "despite_reading": True,
                "note": "the valve has not turned",
            }
            stack.client().call("POST", f"jobs/{job['id']}/resolve", body)
    stack.client().wait_for_run(run["id"], lambda found: not found["in_doubt_count"])
    stack.client().call("POST", f"runs/{run['id']}/abort", {"reason": "end of the test"})
    stack.client().wait_for_run(run["id"], lambda found: found["state"] == "aborted")
    stack.wait_until_online()


POINTS = [
    "accept.before_commit",
    "accept.after_commit",
    "execute.before_started",
    "execute.after_started",
    "execute.before_first_byte",
    "execute.after_first_byte",
    "execute.mid_action",
    "execute.before_actuated",
    "execute.after_actuated",
    "execute.before_done",
    "execute.after_done",
    "uplink.before_send",
    "uplink.after_send",
    "uplink.after_ack",
]
IN_DOUBT = {
    "execute.after_started",
    "execute.before_first_byte",
    "execute.after_first_byte",
    "execute.mid_action",
    "execute.before_actuated",
}
"""After STARTED is on disk and before the answer is, nobody knows."""

COUNT = {"aspirate": 2, "dispense": 4}
"""Where a point knows no action, the job of the transfer that is struck, from one."""


@pytest.mark.parametrize(
    ("point", "stroke"),
    [(point, "aspirate") for point in POINTS]
    + [(point, "dispense") for point in POINTS if point.startswith("execute")],
)
def test_kill_9_at_every_injection_point_never_acts_twice(
    stack: Stack, point: str, stroke: str
) -> None:
    before, acts = volumes_nl(stack), len(strokes(stack))
    where = f"{point}/{stroke}" if point.startswith("execute") else point
    stack.fault_file.write_text(f"{where}@{1 if where != point else COUNT[stroke]}:kill")
    run = start_one_ml(stack)
    seen = stack.client().wait_for_run(run["id"], is_over, 90)
    assert not stack.fault_file.exists(), "the fault never struck"
    doubtful = [job for job in seen["jobs"] if job["state"] == "in_doubt"]
    assert [job["action"] for job in doubtful] == ([stroke] if point in IN_DOUBT else [])
    acted = strokes(stack)[acts:]
    if doubtful:
        seen = answer(stack, seen, doubtful[0], has_happened=stroke in acted)
        acted = strokes(stack)[acts:]
    assert acted.count("aspirate") <= 1
    assert acted.count("dispense") <= 1
    moved = volumes_nl(stack)["reactor_1"] - before["reactor_1"]
    assert moved == (1_000_000 if "dispense" in acted else 0)
    assert seen["state"] == ("complete" if "dispense" in acted else "aborted")
    really_ul = stack.volumes_ul()["reactor_1"]
    assert really_ul == pytest.approx(volumes_nl(stack)["reactor_1"] / 1000, abs=2.0)
    empty_the_syringe(stack)


def start_one_ml(stack: Stack) -> dict[str, Any]:
    """Start a transfer of 1 mL of water into the reactor."""
    keys = stack.keys()
    params = {"source": keys["water"], "target": keys["reactor_1"], "volume": "1 mL"}
    return stack.client().start_step("transfer", params)


def answer(
    stack: Stack, run: dict[str, Any], job: dict[str, Any], *, has_happened: bool
) -> dict[str, Any]:
    """Say what a person who looks at the plunger would say, and end the run where it stands."""
    assert job["question"]["text"].startswith("Was 1.00 mL moved")
    told = "happened" if has_happened else "did_not"
    body = {"answer": told, "despite_reading": True, "note": "looked at the plunger scale"}
    stack.client().call("POST", f"jobs/{job['id']}/resolve", body)

    def is_answered(found: dict[str, Any]) -> bool:
        return is_over(found) and not found["in_doubt_count"]

    stack.client().wait_for_run(run["id"], is_answered, 60)
    # A run that goes on by itself may have been read in the moment before it did.
    seen = stack.client().wait_for_run(run["id"], is_over, 60)
    if seen["state"] == "paused":
        stack.client().call("POST", f"runs/{run['id']}/abort", {"reason": "end of the test"})
        seen = stack.client().wait_for_run(run["id"], lambda found: found["state"] == "aborted")
    return seen


def empty_the_syringe(stack: Stack) -> None:
    """Bring what a broken transfer left in the syringe to waste, by the lab's own means."""
    if not volumes_nl(stack)["pump_1"]:
        return
    keys = stack.keys()
    params = {"pump": keys["pump_1"], "target": keys["waste"]}
    run = stack.client().start_step("empty_syringe", params)
    seen = stack.client().wait_for_run(run["id"], is_over)
    assert seen["state"] == "complete"
    assert volumes_nl(stack)["pump_1"] == 0
