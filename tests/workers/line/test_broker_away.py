"""A line works with the server's broker absent, inside a Celery worker of the host."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from tests.workers.bench import PumpProcess, Server, a_device, a_do, until
from tests.workers.host.test_host import Running
from tests.workers.hub import Hub
from workers.base.host_key import create_key

NOBODY = "redis://127.0.0.1:9/0"


@pytest.fixture
def alone(pump: PumpProcess) -> Iterator[Running]:
    """A host whose server's broker was never there."""
    with tempfile.TemporaryDirectory(prefix="ba") as name:
        folder = Path(name)
        key = create_key(folder / "host.key")
        hub = Hub(Server(), [a_device(pump.url)], key.public_base64)
        with hub.open():
            made = Running(folder, NOBODY, hub, folder / "host.key")
            made.start()
            try:
                yield made
            finally:
                made.stop()
                sys.stdout.write(made.log.read_text())


@pytest.mark.timeout(240)
def test_a_line_starts_and_works_with_the_server_s_broker_absent(
    alone: Running, pump: PumpProcess
) -> None:
    """Commands come over the uplink then; what acts is the line's own Celery worker."""
    hub = alone.hub
    until(alone.is_online, within_s=150)
    first = a_do(hub.server)
    hub.nudge(hub.server.sign(first))
    until(lambda: "complete" in hub.kinds, within_s=30)
    second = msgspec.structs.replace(a_do(hub.server), resources=[])
    hub.nudge(hub.server.sign(second))
    until(lambda: hub.kinds.count("complete") == 2, within_s=30)
    assert pump.moves == ["A300", "A600"]
    pids = {one.body["pid"] for one in hub.events.values() if one.kind == "started"}
    assert len(pids) == 1
    words = (Path("/proc") / str(pids.pop()) / "cmdline").read_bytes().replace(b"\0", b" ").split()
    assert {b"workers.host.process_main", b"line"} <= set(words)
    assert "celery@" in alone.log.read_text() or "edge.execute" in alone.log.read_text()
