"""Samples on their way to the server: each is told until it is stored, or its gap is told."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Iterable, Iterator

import msgspec
from redis.exceptions import RedisError
from websockets.asyncio.client import ClientConnection

from labweb.domain.messages.frames import MAX_FRAME_BYTES
from labweb.domain.messages.telemetry import (
    MAX_SAMPLES_PER_FRAME,
    TelemetryFrame,
    TelemetryGap,
    TelemetryTaken,
)
from workers.base.valkey_store import SampleBatch, ValkeyStore

log = logging.getLogger(__name__)

TELEMETRY_S = 0.1
"""Shortest time between two rounds while the server keeps up."""

MOST_WAITING = 4
"""Frames that the server has not said to have stored."""

ACK_TIMEOUT_S = 10.0
PAUSE_S = 1.0
NOTHING = "0-0"


class LinePosition(msgspec.Struct, frozen=True, kw_only=True):
    """How far the samples of one line have been told."""

    began_s: float
    """When the line's process began; another one counts anew."""

    taken_count: int
    at_s: float
    """Wall clock of the last sample."""

    device_ids: frozenset[str] = frozenset()
    """Who has been heard on the line."""


class StreamPosition(msgspec.Struct, frozen=True, kw_only=True):
    """How far the stream of a host has been told."""

    key: str = NOTHING
    lines: dict[str, LinePosition] = msgspec.field(default_factory=dict)


class SampleDelivery:
    """Sends what the lines have sampled, from where the server stands.

    The place is kept beside the stream, so that a process that begins anew, or a server that
    was away, loses nothing that is still in the stream. What fell out of it is a gap.
    """

    def __init__(self, store: ValkeyStore) -> None:
        """Begin where the store says that the server stands."""
        self._store = store
        self._stored = StreamPosition()
        self._waiting: deque[StreamPosition] = deque()
        self._came = asyncio.Event()

    def take(self, frame: TelemetryTaken) -> None:
        """Take in that the server has stored everything up to a key."""
        while self._waiting and is_reached(self._waiting[0].key, frame.key):
            self._stored = self._waiting.popleft()
        self._came.set()

    async def tell(self, socket: ClientConnection, epoch: Callable[[], int]) -> None:
        """Send frame after frame; a server that stores nothing for 10 s ends the connection.

        Raises:
            TimeoutError: The server does not say that it stores samples.
        """
        self._waiting.clear()
        told = await self._begin()
        kept = self._stored
        while True:
            try:
                if kept is not self._stored:
                    kept = self._stored
                    await asyncio.to_thread(self._store.keep_told, msgspec.json.encode(kept))
                batches = await asyncio.to_thread(self._store.batches, told.key, wait_s=0.2)
            except RedisError:
                await asyncio.sleep(PAUSE_S)
                told = await self._after_silence(told)
                continue
            for part in parts_of(batches):
                told, frame = make_frame(told, part, epoch())
                await self._make_room()
                self._waiting.append(told)
                await socket.send(msgspec.json.encode(frame).decode())
            if len(batches) < self._store.BATCHES_AT_ONCE:
                await asyncio.sleep(TELEMETRY_S)

    async def _begin(self) -> StreamPosition:
        while True:
            try:
                text = await asyncio.to_thread(self._store.told)
            except RedisError:
                await asyncio.sleep(PAUSE_S)
                continue
            self._stored = (
                StreamPosition() if text is None else msgspec.json.decode(text, type=StreamPosition)
            )
            return await self._after_silence(self._stored)

    async def _after_silence(self, told: StreamPosition) -> StreamPosition:
        """Begin a stream anew that was lost with its server: its keys may be lower."""
        try:
            last = await asyncio.to_thread(self._store.last_key)
        except RedisError:
            return told
        if is_reached(told.key, last):
            return told
        self._waiting.clear()
        return StreamPosition(lines=told.lines)

    async def _make_room(self) -> None:
        async with asyncio.timeout(ACK_TIMEOUT_S):
            while len(self._waiting) >= MOST_WAITING:
                self._came.clear()
                await self._came.wait()


def is_reached(key: str, by: str) -> bool:
    """Say whether a place in a stream is not after another one."""
    return _place(key) <= _place(by)


def _place(key: str) -> tuple[int, int]:
    milliseconds, _, number = key.partition("-")
    return int(milliseconds), int(number or 0)


def parts_of(batches: Iterable[SampleBatch]) -> Iterator[list[SampleBatch]]:
    """Divide batches into what fits into one frame each, in order."""
    part: list[SampleBatch] = []
    count = size_bytes = 0
    for batch in batches:
        is_full = count + len(batch.samples) > MAX_SAMPLES_PER_FRAME
        if part and (is_full or size_bytes + batch.size_bytes > MAX_FRAME_BYTES):
            yield part
            part, count, size_bytes = [], 0, 0
        part.append(batch)
        count += len(batch.samples)
        size_bytes += 0 if is_too_large(batch) else batch.size_bytes
    if part:
        yield part


def is_too_large(batch: SampleBatch) -> bool:
    """Say whether no frame may hold a batch."""
    return batch.size_bytes > MAX_FRAME_BYTES


def make_frame(
    told: StreamPosition, batches: list[SampleBatch], epoch: int
) -> tuple[StreamPosition, TelemetryFrame]:
    """Return how far the lines have been told after some batches, and the frame that tells them."""
    lines = dict(told.lines)
    gaps = []
    for batch in batches:
        before = lines.get(batch.line)
        lines[batch.line] = after = _line_after(before, batch)
        gaps += find_gaps(before, after, batch)
    kept = [one for batch in batches if not is_too_large(batch) for one in batch.samples]
    frame = TelemetryFrame(
        epoch=epoch,
        samples=[(one.device_id, one.status, one.at_s, one.value) for one in kept],
        uncertainties_s=[one.uncertainty_s for one in kept],
        lost_count=sum(gap.lost_count or 0 for gap in gaps),
        gaps=gaps,
        key=batches[-1].key,
    )
    return StreamPosition(key=frame.key, lines=lines), frame


def _line_after(before: LinePosition | None, batch: SampleBatch) -> LinePosition:
    heard = frozenset(one.device_id for one in batch.samples)
    known = frozenset() if before is None else before.device_ids
    return LinePosition(
        began_s=batch.began_s,
        taken_count=batch.taken_count,
        at_s=batch.samples[-1].at_s if batch.samples else batch.began_s,
        device_ids=known if heard <= known else known | heard,
    )


def find_gaps(
    before: LinePosition | None, after: LinePosition, batch: SampleBatch
) -> list[TelemetryGap]:
    """Return what is missing before a batch of a line, and the batch itself if it is too large.

    A process counts what it has taken from its begin on. So what is missing is known, but for
    the last moments of a process before: of those it is only known that nobody knows.
    """
    ids = sorted(after.device_ids)
    first_s = batch.samples[0].at_s if batch.samples else after.at_s
    is_same = before is not None and before.began_s == batch.began_s
    found = []
    if before is not None and not is_same:
        found.append(_gap(ids, before.at_s, max(before.at_s, batch.began_s), None, "restart"))
    counted = before.taken_count if before is not None and is_same else 0
    lost_count = batch.taken_count - len(batch.samples) - counted
    since_s = before.at_s if before is not None and is_same else batch.began_s
    # A process whose begin is not told was there before this one listened.
    if lost_count > 0 and since_s > 0:
        found.append(_gap(ids, since_s, first_s, lost_count, "overflow"))
    if is_too_large(batch):
        found.append(_gap(ids, first_s, after.at_s, len(batch.samples), "too_large"))
    return found


def _gap(
    device_ids: list[str], since_s: float, until_s: float, lost_count: int | None, reason: str
) -> TelemetryGap:
    log.warning("telemetry of %d devices has a gap: %s", len(device_ids), reason)
    return TelemetryGap(
        device_ids=device_ids,
        since_s=since_s,
        until_s=max(since_s, until_s),
        lost_count=lost_count,
        reason=reason,
    )
