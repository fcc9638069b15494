"""Hand files over to the server: offered, sent when it wants them, kept until it has them."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import time
from collections.abc import Callable

from websockets.asyncio.client import ClientConnection

from labweb.domain.action_files import (
    MOST_BYTES,
    PART_BYTES,
    UNKNOWN,
    WANTED,
    FileAsked,
    FileGone,
    FileOffer,
    FilePart,
    FileTaken,
)
from workers.base.server_frames import send
from workers.line.action_files import WaitingFile, WaitingFiles

log = logging.getLogger(__name__)

ANSWER_S = 30.0
"""How long the server may take to say what it makes of a file."""

UNREADABLE_AGAIN_S = 60.0
"""How long a file that the disk does not give is left alone; the server knows it as lost then."""

LOOK_S = 1.0
"""How often it is looked for files that wait; one that came too early is offered again."""


class FileDelivery:
    """Hands over the files of a host, one after the other."""

    def __init__(
        self, files: WaitingFiles, retention_s: float, is_caught_up: Callable[[], bool]
    ) -> None:
        self._files = files
        self._is_caught_up = is_caught_up
        self._unknown_since_s: dict[str, float] = {}
        self._unreadable_until_s: dict[str, float] = {}
        self._retention_s = retention_s
        self._taken: asyncio.Queue[FileTaken] = asyncio.Queue()

    async def hear(
        self, socket: ClientConnection, asked: FileTaken | FileAsked, epoch: int
    ) -> None:
        """Take in what the server says of a file; tell it when one that it awaits is gone."""
        if isinstance(asked, FileTaken):
            self._taken.put_nowait(asked)
            return
        wanted = (asked.action_id, asked.device_id, asked.sha256)
        if not await asyncio.to_thread(self._files.has, *wanted):
            log.error("file %s of action %s is lost", asked.sha256, asked.action_id)
            text = "the host named the file, and does not have it any more"
            await send(socket, _gone(asked, epoch, text))

    async def tell(self, socket: ClientConnection, epoch: Callable[[], int]) -> None:
        """Offer each file that waits, until the server has it or does not want it."""
        while True:
            for kept in await asyncio.to_thread(self._files.waiting):
                if time.monotonic() < self._unreadable_until_s.get(kept.path.name, 0.0):
                    continue
                try:
                    await self._hand(socket, kept, epoch())
                except OSError as error:
                    log.error("file %s cannot be handed over: %s", kept.path.name, error)
            await asyncio.sleep(LOOK_S)

    async def _hand(self, socket: ClientConnection, kept: WaitingFile, epoch: int) -> None:
        offer = FileOffer(
            epoch=epoch,
            action_id=kept.action_id,
            device_id=kept.device_id,
            sha256=kept.sha256,
            size_bytes=kept.size_bytes,
        )
        while not self._taken.empty():
            self._taken.get_nowait()
        is_caught_up = self._is_caught_up()
        await send(socket, offer)
        code = await self._answer_to(kept)
        if code != UNKNOWN:
            self._unknown_since_s.pop(kept.path.name, None)
        if code == WANTED:
            if not await self._send(socket, kept, epoch):
                return
            code = await self._answer_to(kept)
        if (
            code is None
            or code == WANTED
            or (code == UNKNOWN and not (is_caught_up and self._is_old(kept)))
        ):
            return
        self._unknown_since_s.pop(kept.path.name, None)
        await asyncio.to_thread(self._files.drop, kept)

    async def _answer_to(self, kept: WaitingFile) -> str | None:
        """Return the code of the server's answer, None when none came in time."""
        try:
            async with asyncio.timeout(ANSWER_S):
                while True:
                    answer = await self._taken.get()
                    if (answer.action_id, answer.sha256) == (kept.action_id, kept.sha256):
                        return answer.code
        except TimeoutError:
            return None

    async def _send(self, socket: ClientConnection, kept: WaitingFile, epoch: int) -> bool:
        """Send a file part by part; False: its bytes are not those any more, which is told."""
        is_whole = kept.size_bytes <= MOST_BYTES
        try:
            data = await asyncio.to_thread(kept.path.read_bytes) if is_whole else b""
        except OSError as error:
            # It stays where it is: a disk that gives it later hands it over all the same.
            log.error("file %s cannot be read: %s", kept.path.name, error)
            self._unreadable_until_s[kept.path.name] = time.monotonic() + UNREADABLE_AGAIN_S
            text = f"the host's disk does not give the file: {error.strerror or error}"
            await send(socket, _gone(kept, epoch, text))
            return False
        self._unreadable_until_s.pop(kept.path.name, None)
        if hashlib.sha256(data).hexdigest() != kept.sha256:
            log.error("file %s is damaged on this host's disk", kept.path.name)
            text = "the file was damaged on the host's disk before the server had it"
            await send(socket, _gone(kept, epoch, text))
            await asyncio.to_thread(self._files.drop, kept)
            return False
        for offset in range(0, len(data), PART_BYTES):
            part = FilePart(
                epoch=epoch,
                action_id=kept.action_id,
                device_id=kept.device_id,
                sha256=kept.sha256,
                offset_bytes=offset,
                size_bytes=len(data),
                data=data[offset : offset + PART_BYTES],
            )
            await send(socket, part)
        return True

    def _is_old(self, kept: WaitingFile) -> bool:
        """Say whether nothing has named a file for so long that nothing will.

        The time runs while every event is with the server, and by a clock that nobody sets.
        """
        now_s = time.monotonic()
        return now_s - self._unknown_since_s.setdefault(kept.path.name, now_s) > self._retention_s


def _gone(file: FileAsked | WaitingFile, epoch: int, message: str) -> FileGone:
    return FileGone(epoch=epoch, action_id=file.action_id, sha256=file.sha256, message=message)
