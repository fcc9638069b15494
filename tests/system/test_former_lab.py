"""A lab that an earlier version left behind, cut off in the middle, goes on with this one.

`former_lab.tar.xz` is the data directory of the starter lab of 2026-11-27, as version 0.1 before
plans were proved at each start: its database as `pg_dump` writes it, the journal of its host, its
keys and its simulated world. All processes were killed at once while a recipe was saved with the
proof of that time, a run waited for an approval, one was paused, and a plunger moved.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from deploy.embedded.database_and_broker import services
from deploy.embedded.postgres import find_programs
from tests.system.stack import CHECKOUT, Stack, running

FORMER = Path(__file__).with_name("former_lab.tar.xz")

ENDS = frozenset({"complete", "failed", "aborted"})

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.fixture(scope="module")
def former() -> Iterator[tuple[Stack, dict[str, str]]]:
    """Load the database into a new cluster, and start the lab on what it left."""
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    try:
        with tarfile.open(FORMER) as packed:
            packed.extractall(folder, filter="data")
        data = folder / "former"
        data.chmod(0o700)
        ids = json.loads((data / "ids.json").read_text("utf-8"))
        with services(data) as urls:
            command = [str(find_programs() / "psql"), "-q", "-v", "ON_ERROR_STOP=1"]
            command += [urls["DATABASE_URL"], "-f", str(data / "labweb.sql")]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        with running(data, speed=10.0, embedded=True, from_nothing=True) as stack:
            yield stack, ids
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def ended(stack: Stack, run_id: str) -> dict[str, Any]:
    """Wait until a run has ended; one that was paused may be so for a moment more."""
    return stack.client().wait_for_run(run_id, lambda run: run["state"] in ENDS, 120)


def test_what_ended_before_is_still_there(former: tuple[Stack, dict[str, str]]) -> None:
    stack, ids = former
    run = stack.client().run(ids["done"])
    assert run["state"] == "complete"
    assert [job["state"] for job in run["jobs"]] == ["complete"] * len(run["jobs"])
    assert stack.client().get(f"runs/{ids['done']}/events")["events"]


def test_a_plunger_that_moved_is_asked_about_and_its_run_ends(
    former: tuple[Stack, dict[str, str]],
) -> None:
    stack, ids = former
    client = stack.client()
    run = client.wait_for_run(ids["stroke"], lambda run: bool(run["in_doubt_count"]), 60)
    (job,) = [job for job in run["jobs"] if job["state"] == "in_doubt"]
    assert job["action"] == "aspirate"
    assert "quarantined" in str(client.call("POST", "workflows/check", draft(client, ids["warm"])))
    answer = {"answer": "did_not", "despite_reading": True, "note": "the syringe is empty"}
    client.call("POST", f"jobs/{job['id']}/resolve", answer)
    client.call("POST", f"runs/{ids['stroke']}/abort", {"reason": "cut off by a power loss"})
    assert ended(stack, ids["stroke"])["state"] == "aborted"


def test_pumps_that_lost_their_power_find_their_zero_again(
    former: tuple[Stack, dict[str, str]],
) -> None:
    stack, _ = former
    client = stack.client()
    for device in client.get("devices")["devices"]:
        if device["key"].startswith("pump_"):
            asked = {"device": device["id"], "action": "initialize", "args": {}}
            run = client.start_step("device_action", asked)
            assert ended(stack, run["id"])["state"] == "complete"


def test_a_paused_run_goes_on_to_its_last_stroke(former: tuple[Stack, dict[str, str]]) -> None:
    stack, ids = former
    client = stack.client()
    assert client.run(ids["paused"])["state"] == "paused"
    client.call("POST", f"runs/{ids['paused']}/resume", {})
    # Pump 2 of the starter lab falls silent in its first stroke into flask 2.
    run = client.wait_for_run(ids["paused"], lambda run: bool(run["in_doubt_count"]), 60)
    assert [job["state"] for job in run["jobs"]][:-1] == ["complete"] * 9
    answer = {"answer": "partly", "moved_ul": 500, "note": "half of it is in the flask"}
    client.call("POST", f"jobs/{run['jobs'][-1]['id']}/resolve", answer)
    client.call("POST", f"runs/{ids['paused']}/abort", {"reason": "half is enough"})
    assert ended(stack, ids["paused"])["state"] == "aborted"


def test_a_run_that_waits_for_an_approval_begins_once_it_is_given(
    former: tuple[Stack, dict[str, str]],
) -> None:
    stack, ids = former
    run = stack.client().run(ids["hot"])
    assert run["state"] == "awaiting_approval"
    answer = {"is_approved": True, "comment": "as planned"}
    path = f"approvals/{run['approval']['id']}/decision"
    stack.client("approver").call("POST", path, answer)
    assert ended(stack, ids["hot"])["state"] == "complete"


def test_a_recipe_that_was_saved_with_its_proof_opens_and_is_held_to_it(
    former: tuple[Stack, dict[str, str]],
) -> None:
    stack, ids = former
    client = stack.client()
    asked = draft(client, ids["warm"])
    found = client.call("POST", "workflows/check", asked)
    assert (found["findings"], found["proof"]) == ([], {"version": 1, "changes": []})
    assert found["plan"]["proved"]["steps"]
    (version,) = client.get(f"workflows/{ids['warm']}")["versions"]
    # The water that was moved meanwhile stands where the recipe was proved with nothing.
    refused = client.raw("POST", "runs", {"version_id": version["id"], "is_second": True})
    assert refused.json()["code"] == "recipe.other_content", refused.text
    run = client.start_version(client.draw(asked["document"]))
    assert ended(stack, run["id"])["state"] == "complete"


def test_the_ledger_of_before_and_after_is_whole(former: tuple[Stack, dict[str, str]]) -> None:
    stack, _ = former
    command = [sys.executable, "-m", "deploy.embedded", "manage", "--data", str(stack.data)]
    done = subprocess.run(
        [*command, "verify_ledger"], capture_output=True, text=True, check=False, cwd=CHECKOUT
    )
    assert done.returncode == 0, done.stdout + done.stderr


def draft(client: Any, workflow_id: str) -> dict[str, Any]:  # noqa: ANN401 - a signed-in client
    """Return the body that checks the draft of a workflow."""
    found = client.get(f"workflows/{workflow_id}")
    return {"document": found["draft"], "workflow_id": workflow_id}
