"""How long after a click on *Start* the first motion of an instrument begins.

A whole lab of real processes, as `make run` starts it: web, database, broker, dispatcher, edge
host. The moment of the click is when the request is sent; the motion's is what the simulated
instrument itself wrote down.
"""

from __future__ import annotations

import argparse
import logging
import shutil
import sqlite3
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.figures import Figure, fsync_ms, p95_ms, report
from tests.system.stack import Stack, is_over, running

CLICKS_COUNT = 60
"""Of twenty, the slowest but one would be the 95th of a hundred: a cold start counts as one."""
LIMIT_MS = 40.0
PAGE_WAITS_S = 0.12
"""How soon the page asks for the run again: a burst of announcements is one question."""

NAME = "One click"


@dataclass(frozen=True, slots=True)
class Click:
    """Moments after one click, ms: each by the clock of whoever saw it, on one machine."""

    answered_ms: float
    """The browser has its answer."""

    accepted_ms: float
    """The command is in the host's journal."""

    started_ms: float
    """STARTED is written; the first byte follows."""

    moved_ms: float
    """The instrument begins to move, by its own record."""


def measure(stack: Stack, count: int) -> list[Click]:
    """Start so many runs one after the other."""
    client, keys = stack.client(), stack.keys()
    params = {"source": keys["water"], "target": keys["waste"], "volume": "1 mL"}
    step = {"id": "step", "kind": "transfer", "params": params, "position": {"x": 0, "y": 0}}
    document = {"schema": "labweb.workflow/1", "name": NAME, "steps": [step], "edges": []}
    made = client.call("POST", "workflows", {"name": NAME, "document": document})
    version = client.call("POST", f"workflows/{made['id']}/versions", {"note": ""})
    clicks = []
    for _ in range(count):
        before = _motions(stack)
        clicked_s = time.time()
        run = client.call("POST", "runs", {"version_id": version["id"]})
        answered_s = time.time()
        time.sleep(PAGE_WAITS_S)
        seen = client.wait_for_run(run["id"], is_over, 300)
        if seen["state"] != "complete":
            raise AssertionError(f"the run is {seen['state']}")
        moved_s = min(one["at"] for one in _motions(stack)[len(before) :])
        moments_s = (answered_s, *_first_events(stack, clicked_s), moved_s)
        clicks.append(Click(*((at_s - clicked_s) * 1000 for at_s in moments_s)))
    return clicks


def _first_events(stack: Stack, after_s: float) -> tuple[float, float]:
    """Return when the first action since then was accepted and started, by the host's journal."""
    path = next(stack.data.rglob("journal.sqlite3"))
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as journal:
        query = "SELECT min(at_s) FROM event WHERE kind = ? AND at_s >= ?"
        accepted, started = (
            float(journal.execute(query, (kind, after_s)).fetchone()[0])
            for kind in ("accepted", "started")
        )
    return accepted, started


def _motions(stack: Stack) -> list[dict[str, Any]]:
    found = [one for pump in ("pump_1", "pump_2") for one in stack.actuations(pump)]
    return sorted(found, key=lambda one: float(one["at"]))


def main(argv: list[str] | None = None) -> int:
    """Measure, print, and fail when the limit is broken."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.clicks", description=__doc__)
    parser.add_argument("--clicks", type=int, default=CLICKS_COUNT)
    options = parser.parse_args(argv)
    logging.getLogger("httpx").setLevel(logging.WARNING)
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    try:
        with running(folder / "lab", speed=60.0) as stack:
            sys.stdout.write(f"an fsync takes {fsync_ms(folder):.2f} ms here\n")
            clicks = measure(stack, options.clicks)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return report("clicks", figures(clicks))


def figures(clicks: list[Click]) -> list[Figure]:
    """Return the medians of the way, and how soon 95 of 100 moved."""
    way = {
        "answer of the server": [one.answered_ms for one in clicks],
        "command in the host's journal": [one.accepted_ms for one in clicks],
        "start on disk": [one.started_ms for one in clicks],
        "first motion": [one.moved_ms for one in clicks],
    }
    return [
        *(
            Figure(name=f"click to {name}, median", value=median(took_ms), limit=None, unit="ms")
            for name, took_ms in way.items()
        ),
        Figure(
            name="click to first motion, p95",
            value=p95_ms([one.moved_ms / 1e3 for one in clicks]),
            limit=LIMIT_MS,
            unit="ms",
        ),
    ]


if __name__ == "__main__":
    sys.exit(main())
