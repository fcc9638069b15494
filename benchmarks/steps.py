"""What a step costs on top of what its device does, beside a plain Celery loop on the same broker.

Every step is a signed command, journaled as accepted, started, actuated and complete, each
with its fsyncs; its device does nothing. `python -m benchmarks.steps` prints the figures and
ends with 1 when a limit is broken.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path
from statistics import mean, median
from uuid import UUID

from celery import Celery
from redis import Redis

from benchmarks import peers
from benchmarks.edge import START_S, Host, a_broker, wait_for
from benchmarks.figures import Figure, fsync_ms, report
from benchmarks.processor import processor_s
from labweb.domain.messages.events import EdgeEvent
from tests.workers.bench import ROOT

STEPS_COUNT = 200
FLAT_COUNTS = (10, 100, 1_000, 10_000)
LEAST_TOLD = 100
HOSTS_COUNT, TIMES = 3, 3
SHORT_TIMES = 9
"""So few steps last some milliseconds, and up to some thousand less than the machine's own whims:
they are measured so often on each of some hosts, one after the other; the middle one counts."""

LONG = 10_000
"""So many are measured once."""

WARM_COUNT = 50
"""So many steps a line has done before it is measured: its first ones stand by themselves."""

PLUG_S = 3_600.0
"""A step before holds the line until all are taken in and the host is at rest; it is cancelled."""

QUIET_S, QUIET_SHARE = 0.5, 0.1
"""A host is at rest when it uses less of a core than this, for so long."""

FLAT_FACTOR = 1.5
"""The dearest length may cost so many times the cheapest."""

PARALLEL_DEVICES_COUNT = 20
PARALLEL_STEP_S = 0.5


@dataclass(frozen=True, slots=True)
class Alone:
    """What a step on one device costs, ms."""

    step_ms: float
    """From start to start."""

    acting_ms: float
    """Of that, from start to end."""

    accept_ms: float
    """To take one in, before."""

    processor_ms: dict[str, float]
    """Processor time of each sort of process, while they run."""


def on_one_device(folder: Path, broker: str, count: int) -> tuple[Alone, Alone]:
    """Return what a line's first steps cost, and so many of the same line after them."""
    hosts_count = HOSTS_COUNT if count < LONG else 1
    times = SHORT_TIMES if count < LEAST_TOLD else TIMES if count < LONG else 1
    firsts, found = [], []
    for number in range(hosts_count):
        first, *later = _on(Host(folder, f"one{count}-{number}", broker, 1), count, times)
        firsts.append(first)
        found += later
    return _middle(firsts), _middle(found)


def _on(host: Host, count: int, times: int) -> list[Alone]:
    """Return what the first steps of a fresh host cost, and so many so often after them."""
    with host.running():
        wait_for(lambda: _lines_count(host) == 1, START_S)
        return [_behind_a_plug(host, one) for one in (WARM_COUNT, *[count] * times)]


def _middle(found: list[Alone]) -> Alone:
    return sorted(found, key=lambda one: one.step_ms)[len(found) // 2]


def _behind_a_plug(host: Host, count: int) -> Alone:
    """Give the host all steps while its device waits, then end that and say no further word."""
    device = host.devices[0]
    before = host.hub.counts["accepted"]
    plug = host.a_step(device, PLUG_S)
    steps = [host.a_step(device) for _ in range(count)]
    began_s = time.monotonic()
    for step in (plug, *steps):
        host.post(step)
    wait_for(lambda: host.hub.counts["accepted"] == before + count + 1, 60.0 + count * 0.1)
    accept_ms = (time.monotonic() - began_s) * 1000 / count
    _wait_for_quiet(host)
    before_s = processor_s(host.pid)
    host.cancel(plug)
    host.wait_for_end(steps[-1].action_id, 60.0 + count * 0.1)
    used_s = processor_s(host.pid) - before_s
    ids = {step.action_id for step in steps}
    started, ended = (
        [event for event in host.events(kind) if event.action_id in ids]
        for kind in ("started", "complete")
    )
    if len(ended) != count:
        raise AssertionError(f"{len(ended)} of {count} steps are complete")
    return Alone(
        step_ms=(ended[-1].at_s - started[0].at_s) * 1000 / count,
        acting_ms=mean(
            (end.at_s - start.at_s) * 1000 for start, end in zip(started, ended, strict=True)
        ),
        accept_ms=accept_ms,
        processor_ms={role: time_s * 1000 / count for role, time_s in used_s.items()},
    )


def _wait_for_quiet(host: Host) -> None:
    """Wait until the host's processes have started to their end, and only wait."""
    deadline_s = time.monotonic() + START_S
    used_s = 0.0
    while time.monotonic() < deadline_s:
        before_s, used_s = used_s, processor_s(host.pid).total()
        if used_s - before_s <= QUIET_SHARE * QUIET_S:
            return
        time.sleep(QUIET_S)
    raise TimeoutError("the host does not come to rest")


def _lines_count(host: Host) -> int:
    """Count the lines whose loop has shown itself."""
    store = Redis(unix_socket_path=str(host.folder / "v"), db=0)
    try:
        return int(store.hlen("edge:alive"))
    finally:
        store.close()


def _ping_pong(hosts: list[Host], turns: list[tuple[Host, int]], count: int) -> float:
    """Send each step when the one before is known to have ended; ms a step, median.

    Who hears the end sends the next one, on the same thread: a server that changes threads
    would wait for Python's lock, and that is not the host's time.
    """
    for host in hosts:
        wait_for(lambda host=host: _lines_count(host) == len(host.devices), START_S)  # type: ignore[misc]
    for host, device in turns:  # the first step of each device also brings its record
        step = host.a_step(host.devices[device])
        host.post(step)
        host.wait_for_end(step.action_id)
    relay = Relay(turns, count)
    for host in hosts:
        host.hub.on_end = relay.take
    relay.post()
    if not relay.is_over.wait(60.0 + count * 0.1):
        raise TimeoutError(f"{len(relay.took_ms)} of {count} steps have ended")
    if relay.wrong:
        raise AssertionError(f"a step ended as {relay.wrong}")
    return median(relay.took_ms)


class Relay:
    """Posts a step, and the next one when that has ended."""

    def __init__(self, turns: list[tuple[Host, int]], count: int) -> None:
        self.took_ms: list[float] = []
        self.is_over = threading.Event()
        self.wrong = ""
        self._turns = islice(cycle(turns), count)
        self._action_id: UUID | None = None
        self._began_s = 0.0

    def post(self) -> None:
        """Post the next step; none: it is over."""
        found = next(self._turns, None)
        if found is None:
            self.is_over.set()
            return
        host, device = found
        self._began_s = time.perf_counter()
        step = host.a_step(host.devices[device])
        self._action_id = step.action_id
        host.post(step)

    def take(self, event: EdgeEvent) -> None:
        """Take the end of a step."""
        if event.action_id != self._action_id:
            return
        self.took_ms.append((time.perf_counter() - self._began_s) * 1000)
        if event.kind != "complete":
            self.wrong = event.kind
            self.is_over.set()
            return
        self.post()


def on_two_devices(folder: Path, broker: str, count: int) -> Figure:
    """Alternate between two devices of a host."""
    host = Host(folder, "two", broker, 2)
    with host.running():
        took_ms = _ping_pong([host], [(host, 0), (host, 1)], count)
    return Figure(name="two devices of a host, in turn", value=took_ms, limit=6.0, unit="ms a step")


def on_two_hosts(folder: Path, broker: str, count: int) -> Figure:
    """Alternate between two hosts."""
    first, second = Host(folder, "a", broker, 1), Host(folder, "b", broker, 1)
    with first.running(), second.running():
        took_ms = _ping_pong([first, second], [(first, 0), (second, 0)], count)
    return Figure(name="two hosts, in turn", value=took_ms, limit=20.0, unit="ms a step")


def in_parallel(folder: Path, broker: str, devices_count: int, count: int) -> Figure:
    """Spread steps of half a second over many devices."""
    host = Host(folder, "many", broker, devices_count)
    each_count = count // devices_count
    with host.running():
        wait_for(lambda: _lines_count(host) == devices_count, START_S * 2)
        began_s = time.monotonic()
        steps = [
            host.a_step(device, PARALLEL_STEP_S)
            for _ in range(each_count)
            for device in host.devices
        ]
        for step in steps:
            host.post(step)
        for step in steps:
            host.wait_for_end(step.action_id, 300.0)
        took_s = time.monotonic() - began_s
    limit_s = 1.3 * each_count * PARALLEL_STEP_S + 2.0
    return Figure(
        name=f"{count} steps on {devices_count} devices",
        value=took_s,
        limit=limit_s,
        unit="s in all",
    )


CELERY_LOOP = """
import sys
from celery import Celery
from redis import Redis
app = Celery("plain", broker=sys.argv[1], fixups=[])
app.conf.update(task_ignore_result=True, worker_prefetch_multiplier=1)
done = Redis(unix_socket_path=sys.argv[2], db=9)
@app.task(name="plain.step")
def step(number):
    done.rpush("done", number)
app.worker_main(["worker", "--pool=solo", "--without-gossip", "--without-mingle",
                 "--without-heartbeat", "--loglevel=ERROR", "--queues=plain"])
"""


def plain_celery(folder: Path, broker: str, count: int) -> Figure:
    """Let a plain worker do as many empty tasks: nothing signed, nothing written to disk."""
    socket = str(folder / "broker")
    command = [sys.executable, "-c", CELERY_LOOP, broker, socket]
    popen = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    app = Celery("plain", broker=broker, set_as_current=False, fixups=[])
    done = Redis(unix_socket_path=socket, db=9, socket_timeout=2 * START_S)
    try:
        app.send_task("plain.step", args=[-1], queue="plain", ignore_result=True)
        if done.blpop(["done"], timeout=START_S) is None:
            raise TimeoutError("the plain worker does not start")
        began_s = time.perf_counter()
        for number in range(count):
            app.send_task("plain.step", args=[number], queue="plain", ignore_result=True)
        for _ in range(count):
            done.blpop(["done"], timeout=60)
        took_ms = (time.perf_counter() - began_s) * 1000 / count
    finally:
        done.close()
        popen.terminate()
        popen.wait()
    return Figure(
        name="peer: plain Celery, nothing durable", value=took_ms, limit=None, unit="ms a step"
    )


def run(
    parent: Path,
    steps_count: int,
    flat_counts: tuple[int, ...],
    devices_count: int,
    *,
    with_peers: bool = True,
) -> list[Figure]:
    """Measure all, each in a fresh host on the same broker."""
    found: list[Figure] = []
    with ExitStack() as stack:
        folder, broker = stack.enter_context(a_broker(parent))
        sys.stdout.write(f"an fsync takes {fsync_ms(folder):.2f} ms here\n")
        found.append(plain_celery(folder, broker, steps_count))
        lengths: dict[int, Alone] = {}
        for count in sorted({steps_count, *flat_counts}):
            first, lengths[count] = on_one_device(folder, broker, count)
            sys.stdout.write(f"  the first {WARM_COUNT} of a line: {render(first)}\n")
            sys.stdout.write(f"  {count} steps after them: {render(lengths[count])}\n")
        found.append(
            Figure(
                name=f"one device, {steps_count} steps",
                value=lengths[steps_count].step_ms,
                limit=2.0,
                unit="ms a step",
            )
        )
        line_ms = lengths[steps_count].processor_ms.get("line", 0.0)
        found.append(Figure(name="of it, processor of its line", value=line_ms, unit="ms a step"))
        found += peers.figures(steps_count) if with_peers else []
        found.append(on_two_devices(folder, broker, steps_count))
        found.append(on_two_hosts(folder, broker, steps_count))
        found.append(in_parallel(folder, broker, devices_count, devices_count * 10))
    return [*found, *flatness(lengths)]


def render(alone: Alone) -> str:
    """Say in one line what a step costs."""
    used = ", ".join(f"{role} {ms:.2f}" for role, ms in sorted(alone.processor_ms.items()))
    return (
        f"{alone.step_ms:.2f} ms a step, {alone.acting_ms:.2f} of it from start to end; taking one"
        f" in {alone.accept_ms:.2f}; processor: {used}"
    )


def flatness(lengths: dict[int, Alone]) -> list[Figure]:
    """Compare the dearest length with the cheapest; by processor time too, that others share."""
    text = f"dearest over cheapest of {', '.join(map(str, sorted(lengths)))} steps"
    step_ms = [one.step_ms for one in lengths.values()]
    found = [Figure(name=text, value=max(step_ms) / min(step_ms), limit=FLAT_FACTOR, unit="times")]
    # Ten steps use less than a tick of the kernel's clock.
    line_ms = [one.processor_ms.get("line", 0.0) for n, one in lengths.items() if n >= LEAST_TOLD]
    if len(line_ms) > 1 and min(line_ms) > 0:
        spread = max(line_ms) / min(line_ms)
        found.append(Figure(name="the same by processor, from 100 on", value=spread, unit="times"))
    return found


def main(argv: list[str] | None = None) -> int:
    """Measure, print, and fail when a limit is broken."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.steps", description=__doc__)
    parser.add_argument("--steps", type=int, default=STEPS_COUNT)
    parser.add_argument("--lengths", type=int, nargs="*", default=list(FLAT_COUNTS))
    parser.add_argument("--devices", type=int, default=PARALLEL_DEVICES_COUNT)
    parser.add_argument("--folder", type=Path, default=Path.home(), help="where journals lie")
    parser.add_argument("--alone", action="store_true", help="without the peers")
    options = parser.parse_args(argv)
    lengths = tuple(options.lengths)
    found = run(
        options.folder,
        options.steps,
        lengths,
        options.devices,
        with_peers=not options.alone,
    )
    return report("steps", found)


if __name__ == "__main__":
    sys.exit(main())
