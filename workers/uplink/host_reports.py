"""What a host tells the server beside events, samples and files: wishes, sightings, tryouts."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

import msgspec
from websockets.asyncio.client import ClientConnection

from labweb.domain.messages.action_asks import ActionAsk, WithdrawAsk
from labweb.domain.messages.certificates_and_sightings import (
    MOST_SIGHTINGS_PER_FRAME,
    Sighting,
    Sightings,
)
from labweb.domain.messages.driver_tryouts import (
    SimulatedModel,
    TryoutAsk,
    TryoutOffer,
    TryoutPart,
    TryoutTold,
)
from workers.base.server_frames import send
from workers.base.valkey_store import ASKS, TRYOUT_TOLD, TRYOUT_WORDS, ValkeyStore

ASKS_S = 0.1
"""Shortest time between two looks for wishes."""

SIGHTINGS_S = 1.0
TRYOUTS_S = 0.1
"""Shortest time between two looks for what is told of tryouts."""

OFFER_S = 2.0
"""How often it is looked whether the offer is another one; it is long."""

ASK_LIFE_S = 5.0
"""Older wishes are not sent: who asked has given up."""


class BridgeWish(msgspec.Struct, frozen=True):
    """A wish, or its end, on its way from a bridge to the uplink."""

    mono_s: float
    frame: ActionAsk | WithdrawAsk


class _Offer(msgspec.Struct, frozen=True):
    """What the process that tries drivers has put down."""

    models: list[SimulatedModel]
    problem: str = ""


async def tell_asks(socket: ClientConnection, store: ValkeyStore, epoch: Callable[[], int]) -> None:
    """Send wishes of nodes beside the host; one that waited for the server is dropped."""
    while True:
        for text in await asyncio.to_thread(store.take_words, ASKS):
            word = msgspec.json.decode(text, type=BridgeWish)
            if time.monotonic() - word.mono_s < ASK_LIFE_S:
                await send(socket, msgspec.structs.replace(word.frame, epoch=epoch()))
        await asyncio.sleep(ASKS_S)


async def tell_sightings(
    socket: ClientConnection, store: ValkeyStore, epoch: Callable[[], int]
) -> None:
    """Send what was seen on wires and networks."""
    while True:
        texts = await asyncio.to_thread(store.take_sightings, MOST_SIGHTINGS_PER_FRAME)
        if texts:
            found = [msgspec.json.decode(text, type=Sighting) for text in texts]
            await send(socket, Sightings(epoch=epoch(), found=found))
        await asyncio.sleep(SIGHTINGS_S)


async def tell_tryouts(
    socket: ClientConnection, store: ValkeyStore, epoch: Callable[[], int]
) -> None:
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


def hand_on(store: ValkeyStore, frame: TryoutPart | TryoutAsk) -> None:
    """Give a word of the server to the process that tries drivers."""
    store.put_word(TRYOUT_WORDS, msgspec.json.encode(frame))
