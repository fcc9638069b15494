"""How long a driver takes from being saved to serving a device, while the lab runs.

A whole lab of real processes, as `make run` starts it. Saved is the moment at which its source is
sent in; a second person's answer follows at once, since how long a person reads is not measured.
Ready is when the host has built it in a process of its own, registered when the server has
switched the device to it, serving when the process of the device's line has loaded it: the last
two by the clocks of server and host, on one machine.
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

from benchmarks.figures import Figure, report
from tests.system.stack import Stack, running

ROUNDS_COUNT = 10
LIMIT_S = 2.0
DEVICES = ("timer_1", "heater_1")
"""One without a wire, and one whose line has an instrument at its other end."""

WITHIN_S = 60.0


@dataclass(frozen=True, slots=True)
class Registration:
    """Seconds after the source was sent in."""

    read_s: float
    """It was read as text, and is proposed."""

    approved_s: float
    """A second person's answer is signed."""

    wanted_s: float
    """The device is to have it."""

    ready_s: float
    """The host has it on its disk, and has built it once."""

    registered_s: float
    """The server sends the device's next job to it."""

    serving_s: float
    """The process of the device's line has loaded it."""


def measure(stack: Stack, device_key: str, number: int) -> Registration:
    """Bring one more version of the driver that a device has, and wait until it serves."""
    admin, approver = stack.client("admin"), stack.client("approver")
    rows = admin.get("devices")["devices"]
    device = admin.get(f"devices/{next(one['id'] for one in rows if one['key'] == device_key)}")
    present = admin.get(f"drivers/{device['driver']['version_id']}")
    text = present["sources"][present["module"]] + f"\n# {device_key}, {number}\n"
    wanted = {"module": present["module"], "source": text, "note": "measured"}
    saved_s = time.time()
    version = admin.call("POST", "drivers", wanted)
    read_s = time.time()
    approver.call("POST", f"drivers/{version['id']}/decision", {"is_approved": True})
    approved_s = time.time()
    choice = {"version_id": version["id"], "reason": "measured"}
    admin.call("POST", f"devices/{device['id']}/driver", choice)
    wanted_s = time.time()
    registered_s = _when_registered(stack, device["id"], version["id"])
    serving_s = _when_told(stack, "driver_serving", version["digest"])
    ready_s = _when_told(stack, "driver_ready", version["digest"])
    moments_s = (read_s, approved_s, wanted_s, ready_s, registered_s, serving_s)
    return Registration(*(at_s - saved_s for at_s in moments_s))


def _when_registered(stack: Stack, device_id: str, version_id: str) -> float:
    deadline_s = time.monotonic() + WITHIN_S
    while time.monotonic() < deadline_s:
        device = stack.client("admin").get(f"devices/{device_id}")
        if device["driver"]["version_id"] == version_id:
            return time.time()
        if device["driver"]["problem"]:
            raise AssertionError(device["driver"]["problem"])
        time.sleep(0.02)
    raise AssertionError(f"not registered within {WITHIN_S:.0f} s")


def _when_told(stack: Stack, kind: str, digest: str) -> float:
    """Return when the host wrote that down, by its journal."""
    path = next(stack.data.rglob("journal.sqlite3"))
    query = "SELECT min(at_s) FROM event WHERE kind = ? AND body LIKE ?"
    deadline_s = time.monotonic() + WITHIN_S
    while time.monotonic() < deadline_s:
        with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as journal:
            found: Any = journal.execute(query, (kind, f"%{digest}%")).fetchone()[0]
        if found is not None:
            return float(found)
        time.sleep(0.02)
    raise AssertionError(f"no {kind} within {WITHIN_S:.0f} s")


def main(argv: list[str] | None = None) -> int:
    """Measure, print, and fail when the limit is broken."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.registration", description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS_COUNT, help="for each device")
    options = parser.parse_args(argv)
    logging.getLogger("httpx").setLevel(logging.WARNING)
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    try:
        with running(folder / "lab", speed=60.0) as stack:
            found = {
                key: [measure(stack, key, number) for number in range(options.rounds)]
                for key in DEVICES
            }
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return report("registration", [one for key in DEVICES for one in figures(key, found[key])])


def figures(key: str, found: list[Registration]) -> list[Figure]:
    """Return the medians of the way, and the longest time to registered."""
    way = ("read", "approved", "wanted", "ready", "registered", "serving")
    slowest_s = max(one.registered_s for one in found)
    return [
        *(
            Figure(
                name=f"{key}: saved to {name}, median",
                value=median(getattr(one, f"{name}_s") for one in found),
                unit="s",
            )
            for name in way
        ),
        Figure(
            name=f"{key}: saved to registered, slowest", value=slowest_s, unit="s", limit=LIMIT_S
        ),
    ]


if __name__ == "__main__":
    sys.exit(main())
