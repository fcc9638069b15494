"""What a host tells the server beside events and samples: wishes, sightings, pictures."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable

import msgspec
from websockets.asyncio.client import ClientConnection

from labweb.domain import pictures as picture_frames
from labweb.domain.messages import (
    Ask,
    EdgeFrame,
    ServerFrame,
    Sighting,
    Sightings,
    SimulatedModel,
    TryoutAsk,
    TryoutOffer,
    TryoutPart,
    TryoutTold,
    WithdrawAsk,
)
from labweb.domain.messages.enrolling import MOST_SIGHTINGS_PER_FRAME
from workers.pictures import Kept, Pictures
from workers.store import ASKS, TRYOUT_TOLD, TRYOUT_WORDS, Store

log = logging.getLogger(__name__)

ACK_TIMEOUT_S = 10.0
ASKS_S = 0.1
"""Shortest time between two looks for wishes."""

SIGHTINGS_S = 1.0
TRYOUTS_S = 0.1
"""Shortest time between two looks for what is told of tryouts."""

OFFER_S = 2.0
"""How often it is looked whether the offer is another one; it is long."""

ASK_LIFE_S = 5.0
"""Older wishes are not sent: who asked has given up."""

PICTURES_S = 1.0
"""How often it is looked for pictures that wait, and one is told again that came too early."""


async def receive(socket: ClientConnection) -> ServerFrame:
    """Return the next frame of the server."""
    frame: ServerFrame = msgspec.json.decode(await socket.recv(), type=ServerFrame)
    return frame


async def send(socket: ClientConnection, frame: EdgeFrame) -> None:
    """Send one frame."""
    await socket.send(msgspec.json.encode(frame).decode())


class Word(msgspec.Struct, frozen=True):
    """A wish, or its end, on its way from a bridge to the uplink."""

    mono_s: float
    frame: Ask | WithdrawAsk


class _Offer(msgspec.Struct, frozen=True):
    """What the process that tries drivers has put down."""

    models: list[SimulatedModel]
    problem: str = ""


async def tell_asks(socket: ClientConnection, store: Store, epoch: Callable[[], int]) -> None:
    """Send wishes of nodes beside the host; one that waited for the server is dropped."""
    while True:
        for text in await asyncio.to_thread(store.take_words, ASKS):
            word = msgspec.json.decode(text, type=Word)
            if time.monotonic() - word.mono_s < ASK_LIFE_S:
                await send(socket, msgspec.structs.replace(word.frame, epoch=epoch()))
        await asyncio.sleep(ASKS_S)


async def tell_sightings(socket: ClientConnection, store: Store, epoch: Callable[[], int]) -> None:
    """Send what was seen on wires and networks."""
    while True:
        texts = await asyncio.to_thread(store.take_sightings, MOST_SIGHTINGS_PER_FRAME)
        if texts:
            found = [msgspec.json.decode(text, type=Sighting) for text in texts]
            await send(socket, Sightings(epoch=epoch(), found=found))
        await asyncio.sleep(SIGHTINGS_S)


async def tell_tryouts(socket: ClientConnection, store: Store, epoch: Callable[[], int]) -> None:
    """Tell what can be simulated, once in each session, and what becomes of drivers on trial."""
    offered, look_s = b"", 0.0
    while True:
        if time.monotonic() >= look_s:
            offer = await asyncio.to_thread(store.tryout_offer)
            if offer != offered and offer:
                found = msgspec.json.decode(offer, type=_Offer)
                frame = TryoutOffer(epoch=epoch(), models=found.models, problem=found.problem)
                await send(socket, frame)
            offered, look_s = offer, time.monotonic() + OFFER_S
        for text in await asyncio.to_thread(store.take_words, TRYOUT_TOLD):
            told = msgspec.json.decode(text, type=TryoutTold)
            await send(socket, msgspec.structs.replace(told, epoch=epoch()))
        await asyncio.sleep(TRYOUTS_S)


def hand_on(store: Store, frame: TryoutPart | TryoutAsk) -> None:
    """Give a word of the server to the process that tries drivers."""
    store.put_word(TRYOUT_WORDS, msgspec.json.encode(frame))


class PictureTeller:
    """Sends pictures that verdicts rest on, until the server has them."""

    def __init__(self, pictures: Pictures, retention_s: float) -> None:
        self._pictures = pictures
        self._retention_s = retention_s
        self._taken: asyncio.Queue[picture_frames.PictureTaken] = asyncio.Queue()

    def take(self, frame: picture_frames.PictureTaken) -> None:
        """Take in what the server says of a picture."""
        self._taken.put_nowait(frame)

    async def tell(self, socket: ClientConnection, epoch: Callable[[], int]) -> None:
        """Send each picture that waits until the server has it, or does not want it."""
        while True:
            for kept in await asyncio.to_thread(self._pictures.waiting):
                try:
                    await self._tell_picture(socket, kept, epoch())
                except OSError as error:
                    log.error("picture %s cannot be read: %s", kept.path.name, error)
            await asyncio.sleep(PICTURES_S)

    async def _tell_picture(self, socket: ClientConnection, kept: Kept, epoch: int) -> None:
        data = await asyncio.to_thread(kept.path.read_bytes)
        for offset in range(0, len(data), picture_frames.PART_BYTES):
            part = picture_frames.Picture(
                epoch=epoch,
                action_id=kept.action_id,
                device_id=kept.device_id,
                sha256=kept.sha256,
                offset_bytes=offset,
                size_bytes=len(data),
                data=data[offset : offset + picture_frames.PART_BYTES],
            )
            await send(socket, part)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(ACK_TIMEOUT_S):
                while (answer := await self._taken.get()).sha256 != kept.sha256:
                    continue
                if answer.code != picture_frames.UNKNOWN or self._is_old(kept):
                    await asyncio.to_thread(self._pictures.drop, kept)

    def _is_old(self, kept: Kept) -> bool:
        """Say whether a picture has waited so long that nothing will name it any more."""
        return time.time() - kept.path.stat().st_mtime > self._retention_s
