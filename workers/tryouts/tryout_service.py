"""The process of a host that tries drivers: takes orders, and tells what becomes of them."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
from uuid import UUID

import msgspec

from labweb.domain.enrollment.driver_bundle import MAX_BUNDLE_BYTES, decode_bundle
from labweb.domain.enrollment.driver_tryout import MOST_AT_ONCE
from labweb.domain.errors import ConformanceError, LabError, StateError
from labweb.domain.messages.driver_tryouts import (
    SimulatedModel,
    TryoutAsk,
    TryoutOrder,
    TryoutPart,
    TryoutTold,
)
from workers.base.config import HostConfig
from workers.base.signatures import is_signed
from workers.base.valkey_store import TRYOUT_TOLD, TRYOUT_WORDS, ValkeyStore
from workers.journal.journal import Journal
from workers.sandbox.confinement import describe, is_possible
from workers.tryouts.simulated_instrument import read_models
from workers.tryouts.tryout import RunningTryout

log = logging.getLogger(__name__)

LOOK_S = 0.05

Word = TryoutPart | TryoutAsk
"""What the uplink hands on."""


class StoredTryoutOffer(msgspec.Struct, frozen=True):
    """What the service has found out when it began, for the uplink to tell in each session."""

    models: list[SimulatedModel]
    problem: str = ""


class TryoutService:
    """Keeps the tryouts of one host."""

    def __init__(self, config: HostConfig, journal: Journal, store: ValkeyStore) -> None:
        self._config, self._journal, self._store = config, journal, store
        self._environment = dict(os.environ)
        self._models: dict[str, SimulatedModel] = {}
        self._tryouts: dict[UUID, RunningTryout] = {}
        self._running: set[asyncio.Task[None]] = set()
        self._gathered: dict[UUID, list[bytes]] = {}
        self._orders: dict[UUID, TryoutOrder] = {}

    async def run(self) -> None:
        """Offer, and serve what is asked, until cancelled."""
        offer = await self._offer()
        self._models = {one.model: one for one in offer.models}
        self._store.take_words(TRYOUT_WORDS)
        self._store.offer_tryouts(msgspec.json.encode(offer))
        try:
            while True:
                for text in await asyncio.to_thread(self._store.take_words, TRYOUT_WORDS):
                    self._take(msgspec.json.decode(text, type=Word))
                await asyncio.sleep(LOOK_S)
        finally:
            self._store.offer_tryouts(b"")
            for tryout in self._tryouts.values():
                tryout.end("the host ends")
            await asyncio.gather(*self._running, return_exceptions=True)

    async def _offer(self) -> StoredTryoutOffer:
        """Find out what can be simulated; source that nobody approved never runs unconfined."""
        if not is_possible():
            return StoredTryoutOffer(
                [], f"drivers are tried on a machine that can confine them: {describe()}"
            )
        try:
            return StoredTryoutOffer(await read_models(self._environment))
        except LabError as error:
            return StoredTryoutOffer([], error.message)

    def _take(self, word: Word) -> None:
        try:
            if isinstance(word, TryoutPart):
                self._gather(word)
            elif word.tryout_id in self._tryouts:
                self._tryouts[word.tryout_id].take(word)
            else:
                raise StateError("the host does not run this tryout", code="tryout.unknown")
        except LabError as error:
            self._gathered.pop(word.tryout_id, None)
            log.error("tryout %s: %s", word.tryout_id, error)
            self._tell(
                TryoutTold(
                    epoch=0,
                    tryout_id=word.tryout_id,
                    state="ended",
                    code=error.code,
                    message=error.message,
                )
            )

    def _gather(self, part: TryoutPart) -> None:
        """Take one piece; with the last one, check the whole and begin.

        Raises:
            LabError: It is not what the server signed for this host and session, or does not fit.
        """
        if part.index == 0:
            self._orders[part.tryout_id] = self._checked_order(part)
            self._gathered[part.tryout_id] = []
        pieces = self._gathered.get(part.tryout_id)
        if pieces is None or part.index != len(pieces):
            raise ConformanceError("a piece of the source is missing", code="driver.bundle")
        pieces.append(part.data)
        if sum(map(len, pieces)) > MAX_BUNDLE_BYTES:
            raise ConformanceError("the source is larger than any", code="driver.bundle")
        if len(pieces) == part.count:
            data = b"".join(self._gathered.pop(part.tryout_id))
            self._begin(self._orders.pop(part.tryout_id), data)

    def _checked_order(self, part: TryoutPart) -> TryoutOrder:
        if part.order is None or not is_signed(part.order, self._journal.command_keys()):
            raise ConformanceError("no known key signed the order", code="tryout.unsigned")
        order = msgspec.json.decode(part.order.body, type=TryoutOrder)
        expected = (part.tryout_id, self._config.host_id, self._journal.host_state().epoch)
        if (order.tryout_id, order.host_id, order.epoch) != expected:
            text = "the order is of another tryout, host or session"
            raise ConformanceError(text, code="tryout.unsigned")
        return order

    def _begin(self, order: TryoutOrder, data: bytes) -> None:
        if order.model not in self._models:
            text = f"this host simulates no {order.model!r:.60}"
            raise StateError(text, code="tryout.no_model")
        if order.tryout_id in self._tryouts or len(self._tryouts) >= MOST_AT_ONCE:
            text = f"this host tries at most {MOST_AT_ONCE} drivers at a time"
            raise StateError(text, code="tryout.busy")
        modules = decode_bundle(data, order.digest)
        tryout = RunningTryout(order, modules, self._tell, self._environment)
        self._tryouts[order.tryout_id] = tryout
        log.info("tryout %s of %s on %s", order.tryout_id, order.digest[:12], order.model)
        task = asyncio.create_task(self._run(tryout))
        self._running.add(task)
        task.add_done_callback(self._running.discard)

    async def _run(self, tryout: RunningTryout) -> None:
        try:
            await tryout.run()
        finally:
            self._tryouts.pop(tryout.id, None)

    def _tell(self, told: TryoutTold) -> None:
        self._store.put_word(TRYOUT_TOLD, msgspec.json.encode(told))


def run_tryouts(config: HostConfig) -> None:
    """Run until told to end."""
    service = TryoutService(config, Journal(config.journal_path), ValkeyStore(config.valkey_url))
    with contextlib.suppress(asyncio.CancelledError):
        asyncio.run(_until_told(service))


async def _until_told(service: TryoutService) -> None:
    task = asyncio.current_task()
    if task is not None:
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    await service.run()
