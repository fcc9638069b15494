"""What comes over the uplink and is for the supervisor to look at wakes it at once."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path

from labweb.domain.messages.devices_and_drivers import DevicesFrame, DriverPart
from tests.workers.bench import Host
from tests.workers.hub import Hub
from tests.workers.uplink.test_uplink import connected, until
from workers.base.host_key import create_key
from workers.base.valkey_store import ValkeyStore
from workers.base.wake_pipe import WakePipe

WITHIN_S = 8.0


async def test_other_devices_and_the_source_of_a_driver_wake_the_supervisor(
    tmp_path: Path, store: ValkeyStore
) -> None:
    host, key = Host(tmp_path / "host", "tcp://127.0.0.1:9"), create_key(tmp_path / "host.key")
    hub = Hub(host.server, [host.device], key.public_base64)
    with contextlib.closing(WakePipe(host.folder / "supervisor.bell")) as bell, hub.open():
        async with connected(host, hub, key, store):
            await until(lambda: hub.frames)
            assert not bell.wait(0.0)
            hub.send(
                DevicesFrame(epoch=hub.server.epoch, devices=[host.device], staged=[host.device])
            )
            assert await asyncio.to_thread(bell.wait, WITHIN_S)
            assert host.journal.staged() == [host.device]
            hub.send(DriverPart(digest=host.device.digest, problem="it is not approved"))
            assert await asyncio.to_thread(bell.wait, WITHIN_S)
    host.journal.close()
