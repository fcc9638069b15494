"""How often somebody may do something: one token bucket for each name."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock

MOST_NAMES = 10_000
"""Names that are remembered; beyond that, the one that was longest silent is forgotten."""


@dataclass(frozen=True, slots=True)
class Rate:
    """How much one name may take: `burst_count` at once, and `per_s` in the long run."""

    per_s: float
    burst_count: float

    def times(self, factor: float) -> Rate:
        """Return the rate that allows so many times as much."""
        return Rate(self.per_s * factor, self.burst_count * factor)


class Buckets:
    """The buckets of all names. It may be asked from several threads.

    They live in this process and are forgotten with it: of several web processes, each has its
    own.
    """

    def __init__(self, rate: Rate, clock: Callable[[], float] = time.monotonic) -> None:
        self.rate = rate
        self._clock = clock
        self._lock = Lock()
        self._levels: OrderedDict[str, tuple[float, float]] = OrderedDict()
        """Name → what is left in its bucket, and when that was so."""

    def take(self, name: str, cost: float = 1.0) -> float:
        """Take so much from a name's bucket.

        Returns:
            0 when it was taken; else how long to wait in seconds, and nothing was taken. What
            costs more than the whole bucket waits for a full one, and then takes all of it.
        """
        cost = min(cost, self.rate.burst_count)
        with self._lock:
            at = self._clock()
            left, since = self._levels.get(name, (self.rate.burst_count, at))
            left = min(self.rate.burst_count, left + (at - since) * self.rate.per_s)
            is_taken = left >= cost
            self._levels[name] = (left - cost if is_taken else left, at)
            self._levels.move_to_end(name)
            if len(self._levels) > MOST_NAMES:
                self._levels.popitem(last=False)
        return 0.0 if is_taken else (cost - left) / self.rate.per_s
