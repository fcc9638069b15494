"""The bell between the processes of a host: heard at once, harmless when nobody listens."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

from tests.workers.bench import Host, a_do
from workers.bell import Bell, ring

LONG_S = 60.0


def test_a_ring_is_heard_at_once_even_one_from_before_the_wait(tmp_path: Path) -> None:
    path = tmp_path / "bell"

    async def listen() -> float:
        bell = Bell(path)
        try:
            ring(path)
            began_s = time.monotonic()
            await bell.wait(LONG_S)
            asyncio.get_running_loop().call_later(0.05, ring, path)
            await bell.wait(LONG_S)
            return time.monotonic() - began_s
        finally:
            bell.close()

    assert asyncio.run(listen()) < LONG_S / 2


def test_a_lost_ring_costs_one_wait(tmp_path: Path) -> None:
    async def listen() -> float:
        bell = Bell(tmp_path / "bell")
        began_s = time.monotonic()
        await bell.wait(0.05)
        bell.close()
        return time.monotonic() - began_s

    assert 0.04 < asyncio.run(listen()) < LONG_S / 2


def test_a_bell_that_nobody_hears_neither_fails_nor_waits(tmp_path: Path) -> None:
    path = tmp_path / "bell"
    ring(path)

    async def hang_up_and_down() -> None:
        Bell(path).close()

    asyncio.run(hang_up_and_down())
    began_s = time.monotonic()
    for _ in range(20_000):
        ring(path)
    assert time.monotonic() - began_s < LONG_S / 2


def test_the_journal_rings_for_an_end_and_not_for_progress(tmp_path: Path) -> None:
    host = Host(tmp_path / "host", "tcp://127.0.0.1:9")

    async def listen() -> tuple[bool, bool]:
        bell = Bell(host.journal.bell_path)
        try:
            host.take(a_do(host.server))
            await asyncio.sleep(0.02)
            is_rung_by_progress = bell.is_rung
            with host.journal.write() as tx:
                tx.append("complete", None, {})
            await bell.wait(LONG_S)
            return is_rung_by_progress, bell.is_rung
        finally:
            bell.close()

    assert asyncio.run(listen()) == (False, False)
