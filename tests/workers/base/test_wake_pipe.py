"""The bell between the processes of a host: heard at once, harmless when nobody listens."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from tests.workers.bench import Host, a_do
from workers.base.wake_pipe import AsyncWakePipe, WakePipe, ring

LONG_S = 60.0


def test_a_ring_is_heard_at_once_even_one_from_before_the_wait(tmp_path: Path) -> None:
    path = tmp_path / "bell"

    async def listen() -> float:
        bell = AsyncWakePipe(path)
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
        bell = AsyncWakePipe(tmp_path / "bell")
        began_s = time.monotonic()
        await bell.wait(0.05)
        bell.close()
        return time.monotonic() - began_s

    assert 0.04 < asyncio.run(listen()) < LONG_S / 2


def test_a_bell_that_nobody_hears_neither_fails_nor_waits(tmp_path: Path) -> None:
    path = tmp_path / "bell"
    ring(path)

    async def hang_up_and_down() -> None:
        AsyncWakePipe(path).close()

    asyncio.run(hang_up_and_down())
    began_s = time.monotonic()
    for _ in range(20_000):
        ring(path)
    assert time.monotonic() - began_s < LONG_S / 2


def test_the_journal_rings_for_an_end_and_not_for_progress(tmp_path: Path) -> None:
    host = Host(tmp_path / "host", "tcp://127.0.0.1:9")

    async def listen() -> tuple[bool, bool]:
        bell = AsyncWakePipe(host.journal.bell_path)
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


def test_who_does_one_thing_after_the_other_hears_a_ring_from_before_the_wait_once(
    tmp_path: Path,
) -> None:
    path = tmp_path / "bell"
    bell = WakePipe(path)
    try:
        ring(path)
        ring(path)
        began_s = time.monotonic()
        assert bell.wait(LONG_S)
        assert not bell.wait(0.05)
        threading.Timer(0.05, ring, [path]).start()
        assert bell.wait(LONG_S)
        assert time.monotonic() - began_s < LONG_S / 2
    finally:
        bell.close()


def test_a_process_that_ends_rings_while_its_parent_waits(tmp_path: Path) -> None:
    path = tmp_path / "bell"
    bell = WakePipe(path)
    before = signal.signal(signal.SIGCHLD, lambda *_: ring(path))
    try:
        began_s = time.monotonic()
        child = subprocess.Popen([sys.executable, "-c", "pass"])
        assert bell.wait(LONG_S)
        assert time.monotonic() - began_s < LONG_S / 2
        assert child.wait() == 0
    finally:
        signal.signal(signal.SIGCHLD, before)
        bell.close()


def test_a_file_in_the_place_of_a_bell_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "supervisor.bell"
    path.write_bytes(b"for ever")
    with pytest.raises(OSError, match="no FIFO"):
        WakePipe(path)
    assert path.read_bytes() == b"for ever"
