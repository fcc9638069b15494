"""The host's Valkey as a place for what may be lost: latest values, samples, signs of life."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, cast
from uuid import UUID

import msgspec
from redis import Redis
from redis.client import PubSub
from redis.exceptions import RedisError

AWAY = (RedisError, OSError)
"""What a server raises that is away, and a process that may open no more files for a connection."""

STREAM = "edge:samples"
LONGEST_STREAM_COUNT = 10_000
"""Batches kept for an uplink that is away; older ones are dropped and counted."""

MOST_SAMPLES_PER_BATCH = 64
"""With the number of batches it bounds what the stream takes of the memory: about 70 MB."""

TOLD = "edge:samples:told"
"""How far the server has stored the stream."""

SIGHTINGS = "edge:sightings"
MOST_SIGHTINGS = 200
"""Kept for an uplink that is away; the oldest go first."""

ASKS, ASKS_TOLD = "edge:asks", "edge:asks_told"
MOST_ASKS = 100
"""Wishes of nodes beside the host, and words about them, that wait to be taken."""

TRYOUT_WORDS, TRYOUT_TOLD, TRYOUT_OFFER = (
    "edge:tryout:words",
    "edge:tryout:told",
    "edge:tryout:offer",
)
"""What is asked of drivers that are tried, what is told of them, and what can be simulated."""

ANCHOR = "edge:anchor"
"""The measure of the server's clock that says most about the present."""

STOP_CHANNEL = "edge:stop"
TIMEOUT_S = 0.5
PICTURE_S = 20
"""How long a picture is at hand after it was taken."""


class StatusSample(msgspec.Struct, frozen=True, array_like=True):
    """One value of one status."""

    device_id: str
    status: str
    at_s: float
    mono_s: float
    value: Any
    uncertainty_s: float | None = None
    """At most so far is `at_s` wrong, by the server's clock; None: the host had not measured."""


@dataclass(frozen=True, slots=True)
class SampleBatch:
    """Samples of one line, and how many it had taken or lost before."""

    key: str
    line: str
    samples: list[StatusSample]
    taken_count: int
    """Samples the line had taken since its process began, these included."""

    began_s: float = 0.0
    """When that process began, on the wall clock; 0: it does not tell."""

    size_bytes: int = 0


class ValkeyStore:
    """Shared by the processes of one host. Nothing here is needed for correctness."""

    BATCHES_AT_ONCE = 200

    def __init__(self, url: str) -> None:
        self._redis: Redis = Redis.from_url(
            url, socket_timeout=TIMEOUT_S, socket_connect_timeout=TIMEOUT_S
        )

        self._heard: PubSub | None = None

    def close(self) -> None:
        """Let go of the connection."""
        self._redis.close()

    def put(
        self, line: str, samples: Sequence[StatusSample], taken_count: int, began_s: float = 0.0
    ) -> bool:
        """Keep samples as latest values and for the uplink; False: they are lost."""
        latest: dict[str, dict[str, bytes]] = {}
        for sample in samples:
            latest.setdefault(sample.device_id, {})[sample.status] = msgspec.json.encode(sample)
        try:
            pipe = self._redis.pipeline(transaction=False)
            for device_id, values in latest.items():
                pipe.hset(_latest(device_id), mapping=cast("Any", values))
            for first in range(0, len(samples), MOST_SAMPLES_PER_BATCH):
                part = samples[first : first + MOST_SAMPLES_PER_BATCH]
                entry = {
                    "line": line,
                    "taken": taken_count - len(samples) + first + len(part),
                    "began": began_s,
                    "samples": msgspec.json.encode(part),
                }
                pipe.xadd(STREAM, cast("Any", entry), maxlen=LONGEST_STREAM_COUNT, approximate=True)
            pipe.execute()
        except AWAY:
            return False
        return True

    def share(self, samples: Sequence[StatusSample]) -> None:
        """Keep values for the other lines alone, until the next sample: no uplink tells them."""
        try:
            pipe = self._redis.pipeline(transaction=False)
            for sample in samples:
                pipe.hset(_latest(sample.device_id), sample.status, msgspec.json.encode(sample))
            pipe.execute()
        except AWAY:
            return

    def latest(self, device_id: UUID, status: str) -> StatusSample | None:
        """Return the last value of a status, or None."""
        try:
            found = self._redis.hget(_latest(str(device_id)), status)
        except AWAY:
            return None
        return (
            None if found is None else msgspec.json.decode(cast("bytes", found), type=StatusSample)
        )

    def latest_of(self, device_ids: Iterable[UUID]) -> list[StatusSample]:
        """Return the last value of every status of devices; one exchange."""
        pipe = self._redis.pipeline(transaction=False)
        for device_id in device_ids:
            pipe.hvals(_latest(str(device_id)))
        try:
            found = cast("list[list[bytes]]", pipe.execute())
        except AWAY:
            return []
        return [msgspec.json.decode(raw, type=StatusSample) for values in found for raw in values]

    def put_anchor(self, text: bytes) -> None:
        """Keep what was measured of the server's clock, for the lines."""
        with suppress(RedisError):
            self._redis.set(ANCHOR, text)

    def anchor(self) -> bytes | None:
        """Return it; None: there is none, or the store does not answer."""
        try:
            return cast("bytes | None", self._redis.get(ANCHOR))
        except RedisError:
            return None

    def put_picture(self, sha256: str, data: bytes) -> bool:
        """Share a picture with the other lines while a reading of it counts."""
        try:
            return bool(self._redis.set(f"edge:picture:{sha256}", data, ex=PICTURE_S))
        except AWAY:
            return False

    def picture(self, sha256: str) -> bytes | None:
        """Return a picture that another line's camera took just now, or None."""
        try:
            return cast("bytes | None", self._redis.get(f"edge:picture:{sha256}"))
        except AWAY:
            return None

    def batches(self, after: str, *, wait_s: float) -> list[SampleBatch]:
        """Return the batches after that key, waiting for the first; `$` means from here on."""
        block = max(1, int(wait_s * 1000))
        found = self._redis.xread({STREAM: after}, count=self.BATCHES_AT_ONCE, block=block)
        entries = cast("list[Any]", found)[0][1] if found else []
        return [_to_batch(key, fields) for key, fields in entries]

    def last_key(self) -> str:
        """Return the key of the newest batch."""
        found = cast("list[Any]", self._redis.xrevrange(STREAM, count=1))
        return found[0][0].decode() if found else "0-0"

    def told(self) -> bytes | None:
        """Return what was kept of how far the stream has been told, or None.

        Raises:
            redis.exceptions.RedisError: The host's Valkey is away.
        """
        return cast("bytes | None", self._redis.get(TOLD))

    def keep_told(self, text: bytes) -> None:
        """Keep how far the stream has been told.

        Raises:
            redis.exceptions.RedisError: The host's Valkey is away; what was kept stays.
        """
        self._redis.set(TOLD, text)

    def show_alive(self, line: str, mono_s: float) -> None:
        """Say that a line's loop has come round."""
        try:
            self._redis.hset("edge:alive", line, mono_s)
        except AWAY:
            return

    def alive(self) -> dict[str, float]:
        """Return when each line's loop last came round, on the monotonic clock."""
        try:
            found = cast("dict[bytes, bytes]", self._redis.hgetall("edge:alive"))
        except AWAY:
            return {}
        return {line.decode(): float(mono) for line, mono in found.items()}

    def forget_line(self, line: str) -> None:
        """Forget a line that is no more."""
        try:
            self._redis.hdel("edge:alive", line)
        except AWAY:
            return

    def announce_stop(self, line: str) -> bool:
        """Tell one line to halt; True: its executor is listening."""
        try:
            return bool(self._redis.publish(f"{STOP_CHANNEL}:{line}", b"stop"))
        except AWAY:
            return False

    def wait_for_stop(self, line: str, *, wait_s: float) -> bool:
        """Wait for the word to halt; False: none came. A broken link counts as silence."""
        try:
            if self._heard is None:
                self._heard = self._redis.pubsub(ignore_subscribe_messages=True)  # type: ignore[no-untyped-call]
                self._heard.subscribe(f"{STOP_CHANNEL}:{line}")
            return self._heard.get_message(timeout=wait_s) is not None
        except AWAY:
            self._heard = None
            threading.Event().wait(wait_s)
            return False

    def keep_sighting(self, text: bytes) -> None:
        """Keep what was seen for the uplink; lost when the server is away."""
        try:
            pipe = self._redis.pipeline(transaction=False)
            pipe.rpush(SIGHTINGS, text)
            pipe.ltrim(SIGHTINGS, -MOST_SIGHTINGS, -1)
            pipe.execute()
        except AWAY:
            return

    def take_sightings(self, most_count: int) -> list[bytes]:
        """Take the oldest sightings out."""
        try:
            return cast("list[bytes] | None", self._redis.lpop(SIGHTINGS, most_count)) or []
        except AWAY:
            return []

    def put_word(self, queue: str, text: bytes) -> bool:
        """Hand a word on between bridge and uplink; False: it is lost."""
        try:
            pipe = self._redis.pipeline(transaction=False)
            pipe.rpush(queue, text)
            pipe.ltrim(queue, -MOST_ASKS, -1)
            pipe.execute()
        except AWAY:
            return False
        return True

    def take_words(self, queue: str) -> list[bytes]:
        """Take the words out that wait."""
        try:
            return cast("list[bytes] | None", self._redis.lpop(queue, MOST_ASKS)) or []
        except AWAY:
            return []

    def offer_tryouts(self, text: bytes) -> None:
        """Say what can be simulated here; empty: nothing any more."""
        try:
            self._redis.set(TRYOUT_OFFER, text)
        except AWAY:
            return

    def tryout_offer(self) -> bytes:
        """Return what can be simulated here; empty: nothing."""
        try:
            return cast("bytes | None", self._redis.get(TRYOUT_OFFER)) or b""
        except AWAY:
            return b""

    def queue_length(self, queue: str) -> int:
        """Return how many wake-ups wait in a queue of the host's broker."""
        return self._redis.llen(queue)

    def ping(self) -> bool:
        """Say whether the server answers."""
        try:
            return bool(self._redis.ping())
        except AWAY:
            return False


def _latest(device_id: str) -> str:
    return f"edge:latest:{device_id}"


def _to_batch(key: bytes, fields: dict[bytes, bytes]) -> SampleBatch:
    return SampleBatch(
        key=key.decode(),
        line=fields[b"line"].decode(),
        samples=msgspec.json.decode(fields[b"samples"], type=list[StatusSample]),
        taken_count=int(fields[b"taken"]),
        began_s=float(fields.get(b"began", 0.0)),
        size_bytes=len(fields[b"samples"]),
    )
