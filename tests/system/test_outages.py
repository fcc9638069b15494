"""Servers and processes that freeze, forget or die in the middle of a run: each stroke once.

The pumps are counted by the simulated instruments themselves, outside of labweb.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import psycopg
import pytest
from redis import Redis

from tests.services import given_urls
from tests.system.stack import BROKER, Stack, is_over
from tests.system.test_survival import is_moving, resolve, start, volume_nl

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
    pytest.mark.skipif(bool(given_urls()), reason="it breaks servers, and those given are others'"),
]

IS_SOAK = bool(os.environ.get("LABWEB_SOAK"))
FROZEN_S = 60.0 if IS_SOAK else 6.0
VOLUME, VOLUME_NL = "9 mL", 9_000_000
RATE = "2 mL/min"
"""Slow enough for a stroke to be seen under way, at sixty times real time."""

POSTGRES = "/bin/postgres -D"


def strokes(stack: Stack) -> int:
    """Count what both pumps physically did."""
    return sum(len(stack.actuations(pump)) for pump in ("pump_1", "pump_2"))


@pytest.fixture(scope="module")
def strokes_of_a_run(stack: Stack) -> int:
    """Give how many strokes the transfer takes when nothing goes wrong."""
    stack.wait_until_online()
    before = strokes(stack)
    seen = stack.client().wait_for_run(start(stack, VOLUME, flow_rate=RATE)["id"], is_over, 120)
    assert seen["state"] == "complete"
    count = strokes(stack) - before
    assert count >= 2
    return count


@contextmanager
def a_run_with_each_stroke_once(stack: Stack, strokes_count: int) -> Iterator[dict[str, Any]]:
    """Start the transfer; after the body has broken something, see it end as if nothing was."""
    stack.wait_until_online()
    before_nl, before = volume_nl(stack, "waste"), strokes(stack)
    run = start(stack, VOLUME, flow_rate=RATE)
    yield run
    seen = resolve(stack, stack.client().wait_for_run(run["id"], is_over, 150))
    assert seen["state"] == "complete", [(j["action"], j["state"]) for j in seen["jobs"]]
    assert strokes(stack) - before == strokes_count
    assert volume_nl(stack, "waste") - before_nl == VOLUME_NL


@contextmanager
def frozen(*pids: int) -> Iterator[None]:
    """Stop processes by SIGSTOP, as a machine that is suspended."""
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        for pid in pids:
            os.kill(pid, signal.SIGCONT)


def pids(stack: Stack, word: str) -> list[int]:
    """Find the lab's processes with that word in their command."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
                environment = (entry / "environ").read_bytes()
            except OSError:
                continue
            is_mine = f"LABWEB_DATA={stack.data}".encode() in environment or str(stack.data) in line
            if is_mine and word in line:
                found.append(int(entry.name))
    assert found, f"no process {word!r}"
    return found


def environment_of(pid: int) -> dict[str, str]:
    text = (Path("/proc") / str(pid) / "environ").read_bytes().decode()
    return dict(item.split("=", 1) for item in text.split("\0") if "=" in item)


@pytest.mark.parametrize(
    "word", ["workers.child", "dispatcher", "uvicorn"], ids=["host", "dispatcher", "web"]
)
def test_a_process_that_is_frozen_for_a_while_goes_on(
    stack: Stack, strokes_of_a_run: int, word: str
) -> None:
    """Of the host all processes but the supervisor, in the middle of a stroke."""
    if word == "workers.child":
        stack.wait_until_online()
    with a_run_with_each_stroke_once(stack, strokes_of_a_run) as run:
        stack.client().wait_for_run(run["id"], is_moving)
        found = pids(stack, word if word != "workers.child" else " run line ")
        if word == "workers.child":
            found += pids(stack, " run accept ") + pids(stack, " run uplink ")
        with frozen(*found):
            time.sleep(FROZEN_S)


def test_a_broker_that_forgets_everything_loses_no_command(
    stack: Stack, strokes_of_a_run: int
) -> None:
    """Both brokers are flushed again and again while a run goes on."""
    with a_run_with_each_stroke_once(stack, strokes_of_a_run) as run:
        stack.client().wait_for_run(run["id"], is_moving)
        sockets = {
            word for line in stack.command_lines() for word in line.split() if ".sock" in word
        }
        brokers = [one for one in sockets if one.endswith(("/vk.sock", "/host.sock"))]
        assert len(brokers) == 2, sockets
        for _ in range(4):
            for path in brokers:
                with Redis(unix_socket_path=path) as client:
                    client.flushall()
            time.sleep(0.4)


def test_a_broker_that_is_killed_again_and_again_loses_no_command(
    stack: Stack, strokes_of_a_run: int
) -> None:
    with a_run_with_each_stroke_once(stack, strokes_of_a_run) as run:
        stack.client().wait_for_run(run["id"], is_moving)
        for _ in range(3):
            stack.kill(BROKER)
            time.sleep(1.5)


def test_a_database_that_is_stopped_at_once_loses_nothing_it_had_confirmed(
    stack: Stack, strokes_of_a_run: int
) -> None:
    """SIGQUIT to its first process is what `pg_ctl stop -m immediate` sends."""
    with a_run_with_each_stroke_once(stack, strokes_of_a_run) as run:
        stack.client().wait_for_run(run["id"], is_moving)
        os.kill(min(pids(stack, POSTGRES)), signal.SIGQUIT)


def test_a_server_killed_between_commit_and_publish_sends_the_command_after_all(
    stack: Stack, strokes_of_a_run: int
) -> None:
    """The broker hangs, so that the dispatcher dies with commands committed and none sent."""
    stack.wait_until_online()
    dispatcher = pids(stack, "dispatcher")
    broker = stack.pid(BROKER)
    url = environment_of(dispatcher[0])["DATABASE_URL"]
    with a_run_with_each_stroke_once(stack, strokes_of_a_run) as run:
        with frozen(broker):
            unsent = _wait_until_committed(url, run["id"])
            for pid in dispatcher:
                os.kill(pid, signal.SIGKILL)
        assert unsent >= 1


def _wait_until_committed(url: str, run_id: str) -> int:
    """Wait until a command of the run stands in the outbox and was never sent."""
    query = (
        "SELECT count(*) FROM runs_outbox o JOIN runs_attempt a ON a.id = o.action_id "
        "JOIN runs_job j ON j.id = a.job_id WHERE j.run_id = %s AND o.published_at IS NULL"
    )
    deadline_s = time.monotonic() + 20
    with psycopg.connect(_conninfo(url), autocommit=True) as connection:
        while True:
            found = connection.execute(query, (run_id,)).fetchone()
            assert found is not None
            if found[0]:
                return int(found[0])
            assert time.monotonic() < deadline_s, "nothing was committed and not sent"
            time.sleep(0.01)


def _conninfo(url: str) -> str:
    """Give libpq's form of an address whose socket stands in its query or its host."""
    parts = urlsplit(url)
    query = {name: values[0] for name, values in parse_qs(parts.query).items()}
    host = query.get("host", unquote(parts.hostname or ""))
    words = {
        "host": host,
        "port": query.get("port", str(parts.port or 5432)),
        "user": query.get("user", unquote(parts.username or "")),
        "password": query.get("password", unquote(parts.password or "")),
        "dbname": query.get("dbname", parts.path.removeprefix("/")),
    }
    return " ".join(f"{name}={value}" for name, value in words.items() if value)
