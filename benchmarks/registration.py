"""How long a driver takes from being saved to serving a device, while the lab runs.

A whole lab of real processes, as `make run` starts it. Saved is the moment at which its source is
sent in; a second person's answer follows at once, since how long a person reads is not measured.
Built is when the host has built it in a process of its own, registered when the server sends the
device's next job to it, serving when the process of the device's line has loaded it: by the clocks
of server and host, on one machine.

Then the same for one of ten pumps that never rest meanwhile, and for all ten of them at once. A
pump that acts is registered when what it was sent has ended, on the version before: that wait is
the device's own time, and a figure of its own. What is ours lies before and after it, and has the
limit: from saved to built, and from the end of the pump's last action to registered. Two pumps
share a line; its process makes room for the next one when what it does for the other has ended.
"""

from __future__ import annotations

import argparse
import logging
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import psycopg

from benchmarks.figures import Figure, report
from tests.labs import lab_of_pumps
from tests.system.outages import conninfo, database_url
from tests.system.replacing import COUNT, LINES_COUNT, Versions, Work, deeds, told
from tests.system.stack import Stack, running
from workers.base.config import load_config
from workers.base.device_lines import lines_of
from workers.journal.journal import Journal

ROUNDS_COUNT = 10
LIMIT_S = 2.0
"""Of what is ours: nobody but the driver's own author can make a device's action shorter."""

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

    built_s: float
    """The host has it on its disk, and has built it once."""

    free_s: float
    """The device has ended what it was sent on the version before; or built, if that is later."""

    registered_s: float
    """The server sends the device's next job to it."""

    left_s: float
    """Its line has ended what it does for another device; or registered, if that is later."""

    serving_s: float
    """The next process of the device's line has loaded it."""

    @property
    def waited_s(self) -> float:
        """How long the device's own work took after the version was built."""
        return self.free_s - self.built_s

    @property
    def switched_s(self) -> float:
        """From the end of the device's own work to the server's switch."""
        return self.registered_s - self.free_s

    @property
    def shared_s(self) -> float:
        """How long the line acted on for another device that it carries."""
        return self.left_s - self.registered_s

    @property
    def taken_over_s(self) -> float:
        """From the end of what the line did to the process that can carry out the next job."""
        return self.serving_s - self.left_s

    @property
    def own_s(self) -> float:
        """From saved to registered without the time of the device's own work."""
        return self.registered_s - self.waited_s


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
    (found,) = _ways(stack, version["digest"], 1, (saved_s, read_s, approved_s, wanted_s))
    return found


def _ways(
    stack: Stack, digest: str, count: int, moments_s: tuple[float, float, float, float]
) -> list[Registration]:
    """Wait until a version serves so many devices; return how each of them got it."""
    registered_s = _by_device(lambda: _switched(stack, digest), count)
    serving_s = _by_device(lambda: told(stack, "driver_serving", digest), count)
    built_s = told(stack, "driver_ready", digest)
    done, beside = deeds(stack), _lines(stack)
    found = []
    for one, at_s in registered_s.items():
        own_s = [deed.ended_at_s for deed in done if deed.device == one and deed.digest != digest]
        before_s = [
            deed.ended_at_s
            for deed in done
            if deed.device in beside[one] and deed.began_at_s < serving_s[one]
        ]
        free_s = max(built_s[one], *(end_s or 0.0 for end_s in own_s), 0.0)
        left_s = max(at_s, *(end_s or 0.0 for end_s in before_s), 0.0)
        later_s = (built_s[one], free_s, at_s, left_s, serving_s[one])
        found.append(Registration(*(one_s - moments_s[0] for one_s in (*moments_s[1:], *later_s))))
    return found


def _by_device(ask: Callable[[], dict[str, float]], count: int) -> dict[str, float]:
    """Return a moment by device, once so many devices have it."""
    deadline_s = time.monotonic() + WITHIN_S
    while len(found := ask()) < count:
        if time.monotonic() > deadline_s:
            raise AssertionError(f"{len(found)} of {count} devices within {WITHIN_S:.0f} s")
        time.sleep(0.02)
    return found


def _switched(stack: Stack, digest: str) -> dict[str, float]:
    """Return when the server switched each device to a version, by its audit."""
    with psycopg.connect(conninfo(database_url(stack))) as connection:
        return dict(connection.execute(_SWITCHED, [digest]).fetchall())


_SWITCHED = """
SELECT subject, extract(epoch FROM at)::float8 FROM accounts_auditentry
WHERE action = 'driver.switch' AND detail ->> 'to' = %s
"""


def _lines(stack: Stack) -> dict[str, set[str]]:
    """Return which devices share a device's line, itself among them."""
    journal = Journal(load_config(stack.data / "host" / "host.json").journal_path)
    try:
        lines = lines_of(journal.devices()).values()
    finally:
        journal.close()
    sharing = [{str(device.id) for device in devices} for devices in lines]
    return {device: devices for devices in sharing for device in devices}


def replace_all(stack: Stack, work: Work) -> list[Registration]:
    """Give ten devices at work one more version of their driver; return how each got it."""
    versions = Versions(stack)
    version, saved_s = versions.bring(lambda text: f"{text}\n# for all\n")
    approved_s = time.time()
    versions.give(version["id"])
    wanted_s = time.time()
    work.until(lambda: len(_switched(stack, version["digest"])) == COUNT, WITHIN_S)
    return _ways(stack, version["digest"], COUNT, (saved_s, approved_s, approved_s, wanted_s))


def at_work(folder: Path, rounds: int) -> list[Figure]:
    """Measure how one of ten pumps that work gets version after version, and then all of them."""
    (folder / "pumps.json").write_bytes(lab_of_pumps(COUNT, lines_count=LINES_COUNT))
    with running(folder / "pumps", lab=folder / "pumps.json", speed=10.0) as stack:
        work = Work(stack, "8 mL")
        work.until(lambda: len({one.device for one in deeds(stack)}) == COUNT)
        found = []
        for number in range(rounds):
            work.go_on()
            found.append(measure(stack, f"pump_{number % COUNT}", number))
        everybody = replace_all(stack, work)
        work.end()
        done = [one for one in deeds(stack) if one.end]
    failed = sum(one.end != "complete" for one in done)
    took_s = median(one.ended_at_s - one.began_at_s for one in done if one.ended_at_s)
    name = f"{COUNT} pumps at work"
    return [
        Figure(name=f"{name}: actions", value=len(done), unit="actions"),
        Figure(name=f"{name}: failed", value=failed, unit="actions", limit=0),
        Figure(name=f"{name}: an action, median", value=took_s, unit="s"),
        *figures(f"one of {name}", found),
        *busy_figures(f"one of {name}", found),
        *figures(f"all {name}", everybody),
        *busy_figures(f"all {name}", everybody),
    ]


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
        busy = at_work(folder, options.rounds)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    alone = [one for key in DEVICES for one in idle_figures(key, found[key])]
    return report("registration", [*alone, *busy])


def figures(key: str, found: list[Registration]) -> list[Figure]:
    """Return the medians of the way."""
    way = ("read", "approved", "wanted", "built", "registered", "serving")
    return [
        _median(f"{key}: saved to {name}", [getattr(one, f"{name}_s") for one in found])
        for name in way
    ]


def idle_figures(key: str, found: list[Registration]) -> list[Figure]:
    """Return the way of a device that rests: all of it is ours."""
    return [
        *figures(key, found),
        _slowest(f"{key}: saved to registered", [one.registered_s for one in found], LIMIT_S),
    ]


def busy_figures(key: str, found: list[Registration]) -> list[Figure]:
    """Return what of the way is ours and has the limit, and what is the device's own time."""
    return [
        _slowest(f"{key}: saved to built", [one.built_s for one in found], LIMIT_S),
        _median(f"{key}: built to its job's end", [one.waited_s for one in found]),
        _slowest(f"{key}: built to its job's end", [one.waited_s for one in found]),
        _slowest(f"{key}: its job's end to registered", [one.switched_s for one in found]),
        _median(f"{key}: registered, but for its job", [one.own_s for one in found]),
        _slowest(f"{key}: registered, but for its job", [one.own_s for one in found], LIMIT_S),
        _slowest(f"{key}: registered to its line's end", [one.shared_s for one in found]),
        _median(f"{key}: its line's end to served", [one.taken_over_s for one in found]),
        _slowest(f"{key}: its line's end to served", [one.taken_over_s for one in found], LIMIT_S),
    ]


def _median(name: str, values_s: list[float]) -> Figure:
    return Figure(name=f"{name}, median", value=median(values_s), unit="s")


def _slowest(name: str, values_s: list[float], limit_s: float | None = None) -> Figure:
    return Figure(name=f"{name}, slowest", value=max(values_s), unit="s", limit=limit_s)


if __name__ == "__main__":
    sys.exit(main())
