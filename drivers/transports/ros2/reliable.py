"""Reliable writers and readers of RTPS: what is sent again, and what is due. Opens nothing.

Source:
    OMG, DDSI-RTPS 2.3, section 8.4: stateful writer and stateful reader.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from drivers.transports.ros2 import rtps
from drivers.transports.ros2.rtps import (
    DataSubmessage,
    HeartbeatSubmessage,
    SampleIdentity,
    Skip,
    Want,
)

Heard = Callable[[SampleIdentity, DataSubmessage], None]
"""Called with a sample and its identity."""

MOST_KEPT = 256
MOST_AHEAD = 256
MOST_LISTENERS = 1024


@dataclass(slots=True)
class Writer:
    """One of our writers."""

    entity: bytes
    topic: str
    type: str
    is_lasting: bool = False
    """Whether who comes late gets what was written before."""

    sequence: int = 0
    listeners: dict[bytes, int] = field(default_factory=dict)
    """By GUID of a matched reader: everything below has arrived there, or is not for it."""

    _kept: dict[int, tuple[bytes, dict[int, bytes]]] = field(default_factory=dict)
    _starts: dict[bytes, int] = field(default_factory=dict)
    _beat_count: int = 0

    def add(self, payload: bytes, inline: dict[int, bytes]) -> int:
        """Keep a sample and return its number."""
        self.sequence += 1
        self._kept[self.sequence] = (payload, inline)
        if not self.is_lasting and len(self._kept) > MOST_KEPT:
            del self._kept[next(iter(self._kept))]
        return self.sequence

    def match(self, guid: bytes) -> bytes:
        """Begin to write to a reader; return what is sent to it at once."""
        if guid in self.listeners or len(self.listeners) >= MOST_LISTENERS:
            return b""
        start = 1 if self.is_lasting else self.sequence + 1
        self.listeners[guid] = self._starts[guid] = start
        return self.samples(guid, self._kept if self.is_lasting else ())

    def unmatch(self, guid: bytes) -> None:
        """Write no more to a reader."""
        self.listeners.pop(guid, None)
        self._starts.pop(guid, None)

    def samples(self, guid: bytes, numbers: Iterable[int]) -> bytes:
        """Render samples for one reader, and the beat that asks what has arrived."""
        parts = [self._sample(guid, number) for number in numbers]
        return b"".join(parts) + self.beat(guid)

    def _sample(self, guid: bytes, number: int) -> bytes:
        kept = self._kept.get(number)
        if kept is None or number < self._starts[guid]:
            return rtps.gap(self.entity, guid[12:], number, number + 1)
        return rtps.data(self.entity, guid[12:], number, kept[0], kept[1])

    def beat(self, guid: bytes) -> bytes:
        """Say what there is for one reader."""
        self._beat_count += 1
        oldest = min(self._kept, default=self.sequence + 1)
        first = max(self._starts[guid], oldest)
        last = max(self.sequence, first - 1)
        return rtps.heartbeat(
            self.entity, guid[12:], (first, last), self._beat_count, is_final=False
        )

    def waiting(self) -> list[bytes]:
        """Return the readers to which something has not arrived."""
        return [guid for guid, base in self.listeners.items() if base <= self.sequence]

    def take_want(self, guid: bytes, want: Want) -> list[int]:
        """Take what a reader says; return what it wants again."""
        if guid not in self.listeners:
            return []
        self.listeners[guid] = max(self.listeners[guid], min(want.base, self.sequence + 1))
        return [number for number in want.missing if number <= self.sequence]


@dataclass(slots=True)
class MatchedWriter:
    """How far we have come with one matched writer."""

    expected: int = 1
    ahead: dict[int, DataSubmessage | None] = field(default_factory=dict)
    """What came too early, by number; None: it never comes."""

    count: int = 0


@dataclass(slots=True)
class ReliableReader:
    """One of our readers."""

    entity: bytes
    topic: str
    type: str
    heard: Heard
    sources: dict[bytes, MatchedWriter] = field(default_factory=dict)
    _early: dict[bytes, int] = field(default_factory=dict)
    """By GUID of a writer that knew of us before we of it: the first number that is for us."""

    def match(self, guid: bytes) -> None:
        """Begin to read from a writer."""
        if guid not in self.sources and len(self.sources) < MOST_LISTENERS:
            self.sources[guid] = MatchedWriter(self._early.pop(guid, 1))

    def unmatch(self, guid: bytes) -> None:
        """Read no more from a writer."""
        self.sources.pop(guid, None)
        self._early.pop(guid, None)

    def take_data(self, guid: bytes, sample: DataSubmessage) -> list[DataSubmessage]:
        """Take a sample; return those that are now due, in their order."""
        source = self.sources.get(guid)
        if source is None or not source.expected <= sample.sequence < source.expected + MOST_AHEAD:
            return []
        source.ahead.setdefault(sample.sequence, sample)
        return _due(source)

    def take_skip(self, guid: bytes, skip: Skip) -> list[DataSubmessage]:
        """Wait no more for what never comes."""
        source = self.sources.get(guid)
        if source is None:
            return []
        if skip.first <= source.expected < skip.end:
            source.expected = skip.end
        first = max(skip.first, source.expected)
        end = min(skip.end, source.expected + MOST_AHEAD)
        for number in (*range(first, end), *skip.others):
            if source.expected <= number < source.expected + MOST_AHEAD:
                source.ahead.setdefault(number, None)
        return _due(source)

    def take_beat(
        self, guid: bytes, beat: HeartbeatSubmessage
    ) -> tuple[list[DataSubmessage], bytes]:
        """Take what a writer has; return what is now due, and the answer.

        What comes before its writer is matched is kept: Fast DDS says it once, and again
        after 3 s only.
        """
        source = self.sources.get(guid)
        if source is None:
            if beat.reader == self.entity and len(self._early) < MOST_LISTENERS:
                self._early[guid] = max(1, beat.first)
            return [], b""
        source.expected = max(source.expected, beat.first)
        due = _due(source)
        last = min(beat.last, source.expected + MOST_AHEAD - 1)
        missing = [n for n in range(source.expected, last + 1) if n not in source.ahead]
        if beat.is_final and not missing:
            return due, b""
        source.count += 1
        return due, rtps.acknack(self.entity, guid[12:], (source.expected, missing), source.count)


def _due(source: MatchedWriter) -> list[DataSubmessage]:
    for number in [number for number in source.ahead if number < source.expected]:
        del source.ahead[number]
    due = []
    while source.expected in source.ahead:
        sample = source.ahead.pop(source.expected)
        source.expected += 1
        due += [] if sample is None else [sample]
    return due
