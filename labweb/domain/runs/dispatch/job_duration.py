"""How long jobs take together: what depends on each other in turn, each device one at a time."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class JobSpan:
    """One job, as far as its time goes."""

    index: int
    after: Collection[int]
    """Indices of the jobs that it waits for."""

    device: Hashable
    takes_s: float


def span_s(parts: Iterable[JobSpan]) -> float:
    """Return how long jobs take from now until the last one ends, s.

    A job begins when all that it waits for has ended and its device is free; of two that wait
    for the same device the one with the smaller index goes first. Other runs, and people who let
    something wait, are not counted.

    Args:
        parts: A job waits only for jobs with smaller indices; one that is not among them has
            ended.
    """
    ends: dict[int, float] = {}
    free: dict[Hashable, float] = {}
    for part in sorted(parts, key=lambda one: one.index):
        begins = max([free.get(part.device, 0.0), *(ends.get(one, 0.0) for one in part.after)])
        ends[part.index] = free[part.device] = begins + part.takes_s
    return max(ends.values(), default=0.0)
