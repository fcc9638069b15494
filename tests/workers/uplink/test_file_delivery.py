"""Files on their way to the server: told as gone, offered again, dropped if nothing names them."""

from __future__ import annotations

import asyncio
import errno
import hashlib
import json
import os
from pathlib import Path
from typing import Any, cast
from uuid import uuid4

import pytest
from websockets.asyncio.client import ClientConnection

from labweb.domain import action_files as handed
from workers.line.action_files import ActionFiles, WaitingFiles
from workers.uplink import file_delivery
from workers.uplink.file_delivery import FileDelivery

NMR = uuid4()


class Heard:
    """The server's end of a socket: what a host sends there."""

    def __init__(self) -> None:
        self.frames: list[dict[str, Any]] = []

    async def send(self, text: str | bytes) -> None:
        self.frames.append(json.loads(text))


def test_a_file_that_is_larger_than_any_is_told_as_gone_and_never_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder that a confined line writes to may hold anything."""
    data, folder = b"larger", tmp_path / "files" / "line"
    ActionFiles(folder).keep(uuid4(), NMR, hashlib.sha256(data).hexdigest(), data)
    waiting = WaitingFiles(folder.parent)
    (kept,) = waiting.waiting()
    monkeypatch.setattr(file_delivery, "MOST_BYTES", len(data) - 1)
    heard, teller = Heard(), FileDelivery(waiting, 1.0, lambda: True)
    assert not asyncio.run(teller._send(cast("ClientConnection", heard), kept, 1))
    assert [one["t"] for one in heard.frames] == ["file_gone"]
    assert waiting.waiting() == []


def test_a_file_that_the_disk_does_not_give_is_told_at_once_and_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, folder = b"there", tmp_path / "files" / "line"
    ActionFiles(folder).keep(uuid4(), NMR, hashlib.sha256(data).hexdigest(), data)
    waiting = WaitingFiles(folder.parent)
    (kept,) = waiting.waiting()
    whole, is_broken = Path.read_bytes, [True]
    heard, teller = Heard(), FileDelivery(waiting, 1.0, lambda: True)

    def read(path: Path) -> bytes:
        if is_broken[0]:
            raise OSError(errno.EIO, "Input/output error")
        return whole(path)

    async def want(for_s: float) -> list[dict[str, Any]]:
        wanted = handed.FileTaken(action_id=kept.action_id, sha256=kept.sha256, code=handed.WANTED)
        heard.frames.clear()
        for _ in range(int(for_s / 0.02)):
            await teller.hear(cast("ClientConnection", heard), wanted, 1)
            await asyncio.sleep(0.02)
        return [one for one in heard.frames if one["t"] != "file_offer"]

    async def hand() -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        task = asyncio.create_task(teller.tell(cast("ClientConnection", heard), lambda: 1))
        broken = await want(0.4)
        is_broken[0] = False
        teller._unreadable_until_s.clear()
        given = await want(0.4)
        task.cancel()
        return broken, given

    monkeypatch.setattr(file_delivery, "LOOK_S", 0.01)
    monkeypatch.setattr(Path, "read_bytes", read)
    broken, given = asyncio.run(hand())
    assert [(one["t"], one["message"]) for one in broken] == [
        ("file_gone", "the host's disk does not give the file: Input/output error")
    ]
    assert given[0]["t"] == "file_part", "should the disk give it after all, it is handed over"
    assert waiting.waiting() == [kept]


def test_a_file_that_nothing_names_is_dropped_only_once_every_event_is_told(
    tmp_path: Path,
) -> None:
    data, folder = b"named later", tmp_path / "files" / "line"
    path = ActionFiles(folder).keep(uuid4(), NMR, hashlib.sha256(data).hexdigest(), data)
    os.utime(path, (0, 0))
    waiting, is_told = WaitingFiles(folder.parent), [False]
    teller = FileDelivery(waiting, 0.05, lambda: is_told[0])

    async def offer() -> None:
        (kept,) = waiting.waiting()
        socket = cast("ClientConnection", Heard())
        task = asyncio.create_task(teller._hand(socket, kept, 1))
        await asyncio.sleep(0.05)
        unknown = handed.FileTaken(
            action_id=kept.action_id, sha256=kept.sha256, code=handed.UNKNOWN
        )
        await teller.hear(socket, unknown, 1)
        await task

    async def offers() -> None:
        await offer()
        await offer()
        assert path.exists(), "an event that names it may not have been told"
        is_told[0] = True
        await offer()
        assert path.exists(), "whatever the clock on the wall says"
        await offer()

    asyncio.run(offers())
    assert not path.exists()
