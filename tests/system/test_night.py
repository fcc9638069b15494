"""A night without the server: what went on meanwhile is in the record when it happened.

Each time is compared with what the simulated instruments wrote down themselves.
"""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import psycopg
import pytest

from tests.services import given_urls
from tests.system.outages import VERBS, conninfo, database_url, frozen
from tests.system.stack import Stack, is_over, running
from tests.system.test_survival import volume_nl

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(900),
    pytest.mark.skipif(bool(given_urls()), reason="it stops servers, and those given are others'"),
]

SPEED = 600.0
NIGHT_S = 8 * 3600.0 / SPEED
"""Real seconds for which the server does not run: eight hours of the lab."""

STROKES_COUNT = 12
STROKE_NL = 500_000
LINE_S = 0.5
"""How long a line may take from what it writes down to the byte at the instrument, and back.

On a quiet machine it takes 1 to 15 ms: an action begins when its start is on disk, before its
first byte. This is no error of a clock, and is not covered by the uncertainty.
"""


@dataclass(frozen=True)
class Motion:
    """What an instrument did, by its own account."""

    verb: str
    began_s: float
    ended_s: float


@pytest.fixture(scope="module")
def stack() -> Iterator[Stack]:
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    try:
        with running(folder / "lab", speed=SPEED, embedded=True) as lab:
            yield lab
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def start(stack: Stack) -> str:
    """Start a batch of strokes and waits that goes on with the server away."""
    keys = stack.keys()
    params = {"source": keys["water"], "target": keys["waste"], "volume": "0.5 mL"}
    wait = {"duration": f"{0.8 * NIGHT_S * SPEED / STROKES_COUNT / 60:.0f} min"}
    steps, edges = [], []
    for place in range(STROKES_COUNT):
        at = {"x": 0, "y": 200 * place}
        steps += [
            {"id": f"pour-{place}", "kind": "transfer", "params": params, "position": at},
            {"id": f"wait-{place}", "kind": "wait", "params": wait, "position": at},
        ]
    for place, (before, after) in enumerate(pairwise(steps)):
        ends = {"source": before["id"], "source_port": "done", "target": after["id"]}
        edges.append({"id": f"edge-{place}", **ends, "target_port": "start"})
    document = {
        "name": "Night",
        "steps": steps,
        "edges": edges,
        "execution": {"on_disconnect": "continue", "max_offline_s": 3600},
    }
    return str(stack.client().start_version(stack.client().draw(document))["id"])


def motions(stack: Stack, pump: str, since: int) -> list[Motion]:
    """Return what a pump did, from what its simulator wrote down as it began and ended."""
    rows = stack.actuations(pump)[since:]
    path = stack.data / "taps" / f"{pump}.endings.jsonl"
    lines = path.read_text().splitlines() if rows else []
    ends = {one["n"]: one["at"] for one in map(json.loads, lines)}
    return [Motion(one["verb"], one["at"], ends[one["n"]]) for one in rows]


def seconds(text: str) -> float:
    return datetime.fromisoformat(text).timestamp()


def pages(stack: Stack, path: str) -> Any:  # noqa: ANN401 - JSON
    return stack.client().get(path)


def test_a_night_without_the_server_is_in_the_record_when_it_happened(stack: Stack) -> None:
    counted = {pump: len(stack.actuations(pump)) for pump in ("pump_1", "pump_2")}
    before_nl = volume_nl(stack, "waste")
    run_id = start(stack)
    stack.client().wait_for_run(run_id, lambda run: run["state"] == "running")
    stopped_s = time.time()
    with frozen([stack.pid("uvicorn"), stack.pid("dispatcher")]):
        time.sleep(NIGHT_S)
        slept = {pump: stack.actuations(pump)[since:] for pump, since in counted.items()}
    back_s = time.time()
    run = stack.client().wait_for_run(run_id, is_over, 120)
    assert run["state"] == "complete", [(j["action"], j["state"]) for j in run["jobs"]]
    at_night = [one for rows in slept.values() for one in rows if one["at"] > stopped_s]
    assert len(at_night) >= STROKES_COUNT, "the host did too little without the server"
    assert len(run["jobs"]) >= 60

    moved = {pump: motions(stack, pump, since) for pump, since in counted.items()}
    _judge_jobs(run, moved)
    _judge_log_and_events(stack, run, back_s)
    _judge_conditions(stack, run)
    _judge_past(stack, run, moved, before_nl)
    report = pages(stack, f"runs/{run_id}/report")
    last_s = max(seconds(job["ended_at"]) for job in run["jobs"])
    assert seconds(report["ended_at"]) == last_s
    assert report["ended_at"] == run["ended_at"]


def _judge_jobs(run: dict[str, Any], moved: dict[str, list[Motion]]) -> None:
    """Each motion lies within its job, and the job begins and ends with it."""
    for pump, found in moved.items():
        jobs = [job for job in run["jobs"] if job["device"]["key"] == pump]
        assert [VERBS.get(job["action"], job["action"]) for job in jobs] == [m.verb for m in found]
        for job, motion in zip(jobs, found, strict=True):
            sure_s = job["uncertainty_s"]
            assert sure_s < 0.5, job
            assert not job["is_bounded"]
            began_s, ended_s = seconds(job["started_at"]), seconds(job["ended_at"])
            about = (job["index"], job["action"], began_s, ended_s, motion, sure_s)
            assert motion.began_s - LINE_S - sure_s <= began_s <= motion.began_s + sure_s, about
            assert motion.ended_s - sure_s <= ended_s <= motion.ended_s + LINE_S + sure_s, about


def _judge_log_and_events(stack: Stack, run: dict[str, Any], back_s: float) -> None:
    """The log of the run and the events of its transactions tell the same times, and both."""
    by_job = {job["id"]: job for job in run["jobs"]}
    lines = pages(stack, f"runs/{run['id']}/log")["lines"]
    assert {line["kind"] for line in lines} >= {"accepted", "started", "complete"}
    late = 0
    for line in lines:
        job = by_job[line["job_id"]]
        assert line["at"] <= line["received_at"]
        late += seconds(line["received_at"]) >= back_s - 1 > seconds(line["at"])
        if line["kind"] == "started":
            assert line["at"] == job["started_at"]
        if line["kind"] == "complete":
            assert line["at"] == job["ended_at"]
    assert late > STROKES_COUNT, "nothing was told only after the night"
    for event in pages(stack, f"runs/{run['id']}/events")["events"]:
        assert event["at"] == by_job[event["job_id"]]["ended_at"]
        assert event["at"] <= event["received_at"]
        assert event["uncertainty_s"] < 0.5


def _judge_conditions(stack: Stack, run: dict[str, Any]) -> None:
    """Without a window they begin when the thing was made, and acts stand in order there."""
    key = stack.keys()["pump_1"]
    devices = {one["key"]: one["id"] for one in pages(stack, "devices")["devices"]}
    found = pages(stack, f"resources/{key}/conditions?device={devices['pump_1']}")
    with psycopg.connect(conninfo(database_url(stack))) as connection:
        row = connection.execute("SELECT at FROM crutd_event WHERE seq = 1").fetchone()
    [stay] = found["stays"]
    assert row is not None
    assert seconds(stay["since"]) == row[0].timestamp()
    told = {act["job_id"]: (act["started_at"], act["ended_at"]) for act in stay["acts"]}
    for job in run["jobs"]:
        if job["device"]["key"] == "pump_1":
            began, ended = told[job["id"]]
            assert (seconds(began), seconds(ended)) == (
                seconds(job["started_at"]),
                seconds(job["ended_at"]),
            )


def _judge_past(
    stack: Stack, run: dict[str, Any], moved: dict[str, list[Motion]], before_nl: int
) -> None:
    """The lab as it was holds in the waste what the simulator had poured there by then."""
    sure_s = max(job["uncertainty_s"] or 0.0 for job in run["jobs"])
    ends = sorted(m.ended_s for found in moved.values() for m in found if m.verb == "dispense")
    starts = sorted(m.began_s for found in moved.values() for m in found if m.verb == "dispense")
    assert len(ends) == STROKES_COUNT
    for count, (began_s, ended_s) in enumerate(zip(starts, ends, strict=True)):
        for at_s, poured in ((began_s - sure_s, count), (ended_s + LINE_S + sure_s, count + 1)):
            at = datetime.fromtimestamp(at_s, UTC).isoformat().replace("+00:00", "Z")
            rows = pages(stack, f"resources?at={at}")["resources"]
            held = next(row["volume_nl"] for row in rows if row["key"] == "waste")
            assert held - before_nl == poured * STROKE_NL, (at, count)
