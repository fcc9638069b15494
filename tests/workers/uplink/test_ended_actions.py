"""What has ended is told at once, and together while more waits to be done."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from tests.workers.bench import Host, a_do
from tests.workers.hub import Hub
from tests.workers.uplink.test_uplink import connected, until
from workers.base.host_key import create_key
from workers.base.valkey_store import ValkeyStore
from workers.uplink import uplink


@pytest.mark.parametrize("more_waits", [False, True])
async def test_ends_are_told_together_only_while_more_waits_to_be_done(
    tmp_path: Path, store: ValkeyStore, more_waits: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(uplink, "STREAM_S", 1.0 if more_waits else 60.0)
    host, key = Host(tmp_path / "host", "tcp://127.0.0.1:9"), create_key(tmp_path / "host.key")
    hub = Hub(host.server, [host.device], key.public_base64)
    with hub.open():
        async with connected(host, hub, key, store):
            await until(lambda: hub.acked == host.journal.head()[0] > 0)
            if more_waits:
                host.take(a_do(host.server))
            for number in range(2):
                with host.journal.write() as tx:
                    tx.append("boot", None, {"number": number})
                if more_waits and number:
                    await asyncio.sleep(0.3)
                    assert hub.acked < host.journal.head()[0]
                await until(lambda: hub.acked == host.journal.head()[0])
    host.journal.close()
