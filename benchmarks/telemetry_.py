"""Telemetry of 100 devices with 10 statuses at 10 Hz, from a line's process to storage and browser.

The line samples as it does on a host, into a Valkey of its own; the uplink's teller brings it to a
real web server and dispatcher over a websocket; a browser's socket watches one device. Beside it:
bare `PUBLISH` to `SUBSCRIBE` of the same samples, one message each. Memory is looked at in every
process but the one that measures, in which the uplink's teller runs as a task: of that one too, but
with all that a benchmark keeps in mind.
"""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from uuid import UUID, uuid4

import msgspec
from django.db import connection
from redis import Redis
from websockets.asyncio.client import ClientConnection, connect

from benchmarks.edge import a_broker, wait_for
from benchmarks.figures import Figure, Options, p95_ms
from benchmarks.memory import Memory, pid_of
from labweb.common.signatures import signing
from labweb.domain.messages.frames import ServerFrame
from labweb.domain.messages.session import Heartbeat
from labweb.domain.messages.telemetry import TelemetryTaken
from labweb.enrollment import services as enrollment_services
from labweb.telemetry.models import Gap, Mark, Rollup, Sample
from tests.builders import Bench, Edge, a_lab
from tests.labweb.web import signed_in
from tests.system.stack import free_port
from tests.workers.bench import ROOT
from workers.base.valkey_store import ValkeyStore
from workers.uplink.sample_delivery import SampleDelivery

SECONDS = 60
DEVICES_COUNT = 100
STATUSES_COUNT = 10
RATE_HZ = 10
BEHIND_MS = 500.0
TAKEN_PERCENT = 97.0
DRAIN_S = 60.0
BARE_COUNT = 20_000


@dataclass(slots=True)
class Seen:
    """What a browser saw, and how memory went."""

    memory: Memory
    behind_s: list[float] = field(default_factory=list)
    taken_count: int = 0


def figures(options: Options) -> Iterator[Figure]:
    """Measure for so many seconds and tell what came of each sample."""
    seconds = options.size or SECONDS
    signing.ensure_key()
    bench = a_lab()
    ids = _devices(bench)
    with ExitStack() as stack:
        parent = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="bt", dir="/tmp")))
        folder, _ = stack.enter_context(a_broker(parent))
        url = f"unix://{folder / 'broker'}?db=0"
        port = free_port()
        web = _process(
            stack,
            "-m",
            "uvicorn",
            "labweb.asgi:application",
            "--port",
            str(port),
            "--no-access-log",
        )
        dispatcher = _process(stack, "manage.py", "dispatcher")
        cookie = signed_in(bench.people["observer"]).cookies["sessionid"].value
        listed = folder / "ids"
        listed.write_text(json.dumps([str(one) for one in ids]))
        line = [sys.executable, "-m", "benchmarks.telemetry_line", url, str(seconds), str(listed)]
        roots = {
            "web server": web.pid,
            "dispatcher": dispatcher.pid,
            "database": pid_of("postgres", Path(os.environ["LABWEB_DATA"])),
            "server's Valkey": pid_of("valkey-server", Path(os.environ["LABWEB_DATA"])),
            "host's Valkey": pid_of("valkey-server", folder),
            "host's uplink, in the benchmark": os.getpid(),
        }
        seen = Seen(Memory(roots))
        asyncio.run(_measure(Edge(bench), cookie, ids[0], line, port, seen))
        with suppress(TimeoutError):
            wait_for(lambda: not Mark.objects.filter(level_s=1).exists(), DRAIN_S)
        yield from _told(seen, seconds)
        yield Figure(name="bare PUBLISH to SUBSCRIBE", value=_bare(url), unit="samples/s")


def _told(seen: Seen, seconds: int) -> Iterator[Figure]:
    stored = Sample.objects.count()
    lost = {row.since: row.lost_count or 0 for row in Gap.objects.all()}
    wanted = DEVICES_COUNT * STATUSES_COUNT * RATE_HZ
    yield Figure(
        name="taken by the line, of 10 000 samples a second",
        value=100.0 * seen.taken_count / seconds / wanted,
        unit="%",
        limit=TAKEN_PERCENT,
        is_floor=True,
    )
    yield Figure(name="stored", value=stored / seconds, unit="samples/s")
    yield Figure(name="told as gaps", value=sum(lost.values()), unit="samples")
    missing = seen.taken_count - stored - sum(lost.values())
    yield Figure(name="neither stored nor told as a gap", value=missing, unit="samples", limit=0)
    rolled = sum(Rollup.objects.filter(level_s=1).values_list("count", flat=True))
    yield Figure(name="stored and not rolled up", value=stored - rolled, unit="samples", limit=0)
    yield Figure(
        name="browser behind the edge, p95", value=p95_ms(seen.behind_s), unit="ms", limit=BEHIND_MS
    )
    yield from seen.memory.figures()
    with connection.cursor() as cursor:
        cursor.execute("SELECT pg_total_relation_size('telemetry_sample')")
        size = cursor.fetchone()[0]
    yield Figure(name="a stored sample", value=size / max(1, stored), unit="bytes")


def _devices(bench: Bench) -> list[UUID]:
    """Admit a hundred devices to the host, each where the pump stands."""
    pump = bench.device("pump_1")
    ids = [uuid4() for _ in range(DEVICES_COUNT)]
    for number, one in enumerate(ids):
        enrollment_services.found_device(
            bench.lab,
            one,
            driver=pump.driver,
            key=f"teller_{number}",
            name=f"Teller {number}",
            host_id=bench.host.id,
            transport=f"virtual:teller_{number}",
            config=pump.config,
            nodes=pump.nodes,
            state="enrolled",
        )
    return ids


def _process(stack: ExitStack, *arguments: str) -> subprocess.Popen[bytes]:
    popen = subprocess.Popen(
        [sys.executable, *arguments],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=dict(os.environ),
    )
    stack.callback(popen.wait)
    stack.callback(popen.terminate)
    return popen


async def _measure(
    edge: Edge, cookie: str, watched: UUID, line: list[str], port: int, seen: Seen
) -> None:
    """Connect uplink and browser, let the line sample, and wait until all of it is stored."""
    store = ValkeyStore(line[3])
    teller = SampleDelivery(store)
    async with await _open(f"ws://127.0.0.1:{port}/ws/edge/v1/") as uplink:
        epoch = await _greet(uplink, edge)
        headers = {"Cookie": f"sessionid={cookie}", "Origin": f"http://127.0.0.1:{port}"}
        async with connect(
            f"ws://127.0.0.1:{port}/ws/v1/", additional_headers=headers, proxy=None
        ) as browser:
            await browser.send(json.dumps({"subscribe": [f"telemetry:{watched}"]}))
            work = (
                _hear(uplink, teller),
                _live(uplink, epoch),
                teller.tell(uplink, lambda: epoch),
                _watch(browser, seen),
            )
            tasks = [asyncio.create_task(one) for one in work]
            try:
                sampling = await asyncio.create_subprocess_exec(
                    *line, cwd=ROOT, stdout=subprocess.PIPE
                )
                seen.memory.begin("host's line", sampling.pid)
                tasks.append(asyncio.create_task(seen.memory.watch()))
                told, _ = await sampling.communicate()
                seen.taken_count = int(told)
                await _drained(store, tasks)
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)


async def _open(url: str) -> connect:
    """Wait until the server listens."""
    deadline_s = time.monotonic() + DRAIN_S
    while True:
        try:
            async with connect(url, proxy=None):
                return connect(url, proxy=None, max_size=None)
        except OSError:
            if time.monotonic() > deadline_s:
                raise
            await asyncio.sleep(0.2)


async def _greet(uplink: ClientConnection, edge: Edge) -> int:
    nonce = json.loads(await uplink.recv())["nonce"]
    await uplink.send(msgspec.json.encode(edge.hello(nonce)).decode())
    return int(json.loads(await uplink.recv())["epoch"])


async def _hear(uplink: ClientConnection, teller: SampleDelivery) -> None:
    async for text in uplink:
        frame = msgspec.json.decode(text, type=ServerFrame)
        if isinstance(frame, TelemetryTaken):
            teller.take(frame)


async def _live(uplink: ClientConnection, epoch: int) -> None:
    while True:
        beat = Heartbeat(
            epoch=epoch,
            mono_s=time.monotonic(),
            seq_head=0,
            stop_latched=False,
            disk_free_bytes=10**12,
        )
        await uplink.send(msgspec.json.encode(beat).decode())
        await asyncio.sleep(1.0)


async def _watch(browser: ClientConnection, seen: Seen) -> None:
    async for text in browser:
        now_s = time.time()
        for _, at_s, _ in json.loads(text).get("data", {}).get("samples", []):
            seen.behind_s.append(now_s - at_s)


async def _drained(store: ValkeyStore, tasks: list[asyncio.Task[None]]) -> None:
    """Wait until the server has stored the stream; a task that ended says why it cannot."""
    async with asyncio.timeout(DRAIN_S):
        while True:
            for task in tasks:
                if task.done():
                    task.result()
            told = store.told()
            if told is not None and json.loads(told)["key"] == store.last_key():
                return
            await asyncio.sleep(0.1)


def _bare(url: str) -> float:
    """Return how many samples a second go from a publisher to a subscriber, one message each."""
    server: Redis = Redis.from_url(url)
    told = json.dumps([str(uuid4()), "level_0_c", time.time(), 20.0])
    with server.pubsub(ignore_subscribe_messages=True) as heard:  # type: ignore[no-untyped-call]
        heard.subscribe("bare")
        heard.get_message(timeout=1.0)
        publisher = threading.Thread(target=_publish, args=(url, told))
        begun_s, count = time.perf_counter(), 0
        publisher.start()
        while count < BARE_COUNT:
            message = heard.get_message(timeout=5.0)
            if message is not None:
                json.loads(message["data"])
                count += 1
        took_s = time.perf_counter() - begun_s
        publisher.join()
    return BARE_COUNT / took_s


def _publish(url: str, told: str) -> None:
    server: Redis = Redis.from_url(url)
    for _ in range(BARE_COUNT):
        server.publish("bare", told)
