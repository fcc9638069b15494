"""A host that comes back with ten thousand events tells them within a minute."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

import pytest

from tests.faults.kills.lab import Ledger
from tests.workers.bench import BOOT_ID, HOST_ID, Host
from workers.base.config import HostConfig, ValkeyConfig
from workers.base.host_key import create_key
from workers.base.valkey_store import ValkeyStore
from workers.enrollment.host_identity import HostIdentity
from workers.uplink.uplink import Uplink

EVENTS_COUNT = 10_000
WITHIN_S = 60.0


@pytest.mark.timeout(180)
async def test_ten_thousand_events_are_told_within_a_minute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LABWEB_BOOT_ID", BOOT_ID)
    host = Host(tmp_path / "host", "tcp://127.0.0.1:9")
    with host.journal.write() as tx:
        for number in range(EVENTS_COUNT):
            tx.append("refused", None, {"code": "test.many", "message": f"number {number}" * 9})
    key = create_key(tmp_path / "host.key")
    hub = Ledger(host.server, [host.device], key.public_base64)
    with hub.open():
        config = HostConfig(
            host_id=HOST_ID,
            name="bench",
            server_url=hub.url,
            broker_url="memory://",
            data_dir=str(host.folder),
            key_file=str(tmp_path / "host.key"),
            valkey=ValkeyConfig(socket="/nowhere"),
        )
        made = Uplink(
            config,
            host.journal,
            HostIdentity(key, Path("-"), None, None),
            ValkeyStore("unix:///nowhere"),
            lambda _: None,
        )
        began_s = time.monotonic()
        task = asyncio.create_task(made.run())
        async with asyncio.timeout(WITHIN_S * 2):
            while host.journal.acked_seq() < EVENTS_COUNT:
                await asyncio.sleep(0.05)
        took_s = time.monotonic() - began_s
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    assert len(hub.events) >= EVENTS_COUNT
    assert took_s < WITHIN_S
    host.journal.close()
