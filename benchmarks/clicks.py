"""How long after a click on *Start* the first motion of an instrument begins.

A whole lab of real processes, as `make run` starts it: web, database, broker, dispatcher, edge
host. The moment of the click is when the request is sent; the motion's is what the simulated
instrument itself wrote down.
"""

from __future__ import annotations

import argparse
import logging
import shutil
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.figures import Figure, fsync_ms, p95_ms, report
from tests.system.stack import Stack, is_over, running

CLICKS_COUNT = 20
LIMIT_MS = 40.0
NAME = "One click"


def measure(stack: Stack, count: int) -> list[float]:
    """Start so many runs one after the other; return ms from click to first motion of each."""
    client, keys = stack.client(), stack.keys()
    params = {"source": keys["water"], "target": keys["waste"], "volume": "1 mL"}
    step = {"id": "step", "kind": "transfer", "params": params, "position": {"x": 0, "y": 0}}
    document = {"schema": "labweb.workflow/1", "name": NAME, "steps": [step], "edges": []}
    made = client.call("POST", "workflows", {"name": NAME, "document": document})
    version = client.call("POST", f"workflows/{made['id']}/versions", {"note": ""})
    took_ms = []
    for _ in range(count):
        before = _motions(stack)
        clicked_s = time.time()
        run = client.call("POST", "runs", {"version_id": version["id"]})
        seen = client.wait_for_run(run["id"], is_over, 300)
        if seen["state"] != "complete":
            raise AssertionError(f"the run is {seen['state']}")
        began_s = min(one["at"] for one in _motions(stack)[len(before) :])
        took_ms.append((began_s - clicked_s) * 1000)
    return took_ms


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
            took_ms = measure(stack, options.clicks)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    figures = [
        Figure(name="click to first motion, median", value=median(took_ms), limit=None, unit="ms"),
        Figure(
            name="click to first motion, p95",
            value=p95_ms([one / 1e3 for one in took_ms]),
            limit=LIMIT_MS,
            unit="ms",
        ),
    ]
    return report("clicks", figures)


if __name__ == "__main__":
    sys.exit(main())
