"""When a thing happened at a host, by the server's clock, and how well that is known.

A host reads two clocks of its own with each event: one that people and programs set, and one
that only runs, from one start of the machine to the next. In a session it measures how far the
server's clock is from the second. `docs/times.md` says the rule in ten lines.

Source:
    RFC 5905, section 8: the offset from four readings, at most half the round trip wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import msgspec

from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.host_journal.host_moment import HostMoment

DRIFT_RATIO = 1e-4
"""How far two clocks run apart at most, per second; quartz does so by half of it."""

READS_TO_S = 1e-6
"""What a number of seconds since 1970 tells at best: a double of that size has steps of 0.24 µs."""

MOST_ANCHORS = 48
"""Measures that a host keeps: enough for a night without the server, and the time after it."""


class ClockAnchor(msgspec.Struct, frozen=True, kw_only=True):
    """One measure: at this reading of the host's clocks it was that time at the server."""

    boot_id: str
    mono_s: float
    wall_s: float
    server_at_s: float
    error_s: float
    """Half the round trip: at most so far is `server_at_s` wrong."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """A question and its answer, read by two clocks."""

    asked: HostMoment
    """By the host, before it asked."""

    heard_at_s: float
    """By the server, when the question came."""

    told_at_s: float
    """By the server, when it answered."""

    got_mono_s: float
    """By the host, when the answer came: the same clock as `asked.mono_s`."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A moment of a host by the server's clock."""

    at_s: float
    uncertainty_s: float | None
    """At most so far is it wrong; None: nobody measured, and the host's clock was believed."""


@dataclass(frozen=True, slots=True)
class Cause:
    """What came before: a dispatch, which the server itself timed, or an earlier event."""

    at_s: float
    uncertainty_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Happened:
    """When something happened, by the server's clock."""

    at_s: float
    uncertainty_s: float
    is_bounded: bool = False
    """No clock told it: it lies between its cause and its reception, which is all that is known."""


def anchor_of(exchange: Exchange) -> ClockAnchor | None:
    """Return what an exchange measures; None: a clock was set meanwhile, so it measures nothing."""
    there_s = exchange.told_at_s - exchange.heard_at_s
    round_s = exchange.got_mono_s - exchange.asked.mono_s - there_s
    if there_s < 0 or round_s < -DRIFT_RATIO * there_s - READS_TO_S:
        return None
    half_s = (exchange.got_mono_s - exchange.asked.mono_s) / 2
    return ClockAnchor(
        boot_id=exchange.asked.boot_id,
        mono_s=exchange.asked.mono_s + half_s,
        wall_s=exchange.asked.wall_s + half_s,
        server_at_s=(exchange.heard_at_s + exchange.told_at_s) / 2,
        error_s=max(round_s, 0.0) / 2 + DRIFT_RATIO * half_s + READS_TO_S,
    )


def with_anchor(anchors: Sequence[ClockAnchor], fresh: ClockAnchor) -> tuple[ClockAnchor, ...]:
    """Return the measures to keep, in order, with one more.

    One that says less than another about every moment is dropped; where there are too many, the
    one whose neighbours say almost as much, so that what is left spans all the time.
    """
    known = [one for one in anchors if not _says_less(one, fresh)]
    if not any(_says_less(fresh, one) for one in known):
        known.append(fresh)
    while len(known) > MOST_ANCHORS:
        known.remove(min(known[:-1], key=lambda one: _loss_s(one, known)))
    return tuple(known)


def _says_less(one: ClockAnchor, than: ClockAnchor) -> bool:
    return one.boot_id == than.boot_id and _error_s(than, one.mono_s) <= one.error_s


def _loss_s(one: ClockAnchor, known: Iterable[ClockAnchor]) -> float:
    """Return how much less is known at a measure's own moment without it; its boot's last: all."""
    others = [o for o in known if o is not one and o.boot_id == one.boot_id]
    return min((_error_s(o, one.mono_s) for o in others), default=float("inf")) - one.error_s


def _error_s(anchor: ClockAnchor, mono_s: float) -> float:
    return anchor.error_s + DRIFT_RATIO * abs(mono_s - anchor.mono_s)


def _read(anchor: ClockAnchor, at: HostMoment) -> Estimate:
    gone_s = at.mono_s - anchor.mono_s
    return Estimate(anchor.server_at_s + gone_s, _error_s(anchor, at.mono_s))


def estimate(anchors: Sequence[ClockAnchor], at: HostMoment) -> Estimate:
    """Return a moment of a host by the server's clock, by the measure that says most about it.

    Of a start of the machine in which nobody measured, the clock that is set is believed, as
    far from the server's as it was last; how wrong that is nobody knows.

    Example:
        >>> one = Anchor(boot_id="b", mono_s=5.0, wall_s=90.0, server_at_s=100.0, error_s=0.01)
        >>> estimate([one], Moment(boot_id="b", mono_s=15.0, wall_s=0.0))
        Estimate(at_s=110.0, uncertainty_s=0.011)
    """
    best = best_of(anchors, at)
    return _believed(anchors, at) if best is None else _read(best, at)


def best_of(anchors: Iterable[ClockAnchor], at: HostMoment) -> ClockAnchor | None:
    """Return the measure that says most about a moment; None: nobody measured in its boot."""
    same = (one for one in anchors if one.boot_id == at.boot_id)
    return min(same, key=lambda one: _error_s(one, at.mono_s), default=None)


def dated(event: EdgeEvent, anchors: Sequence[ClockAnchor]) -> EdgeEvent:
    """Return an event of a host with its moment by the server's clock."""
    if event.mono_s is None:
        return event
    at = HostMoment(boot_id=event.boot_id, mono_s=event.mono_s, wall_s=event.at_s)
    found = estimate(anchors, at)
    return msgspec.structs.replace(event, happened_s=found.at_s, uncertainty_s=found.uncertainty_s)


def _believed(anchors: Sequence[ClockAnchor], at: HostMoment) -> Estimate:
    last = max(anchors, key=lambda one: one.server_at_s, default=None)
    ahead_s = 0.0 if last is None else last.server_at_s - last.wall_s
    return Estimate(at.wall_s + ahead_s, None)


def told_moment(event: EdgeEvent) -> Estimate:
    """Return the moment that a host tells of an event; without one, its clock is believed."""
    if event.happened_s is None:
        return Estimate(event.at_s, None)
    return Estimate(event.happened_s, event.uncertainty_s)


def latest(events: Sequence[EdgeEvent], received_at_s: float) -> list[float]:
    """Return by when each event had happened: when it was heard of, or a later one had at most.

    Args:
        events: What a host tells, in the order in which it happened there.
        received_at_s: When the server heard of them.
    """
    found, by_s = [], received_at_s
    for event in reversed(events):
        told = told_moment(event)
        if told.uncertainty_s is not None:
            by_s = min(by_s, told.at_s + told.uncertainty_s)
        found.append(by_s)
    return found[::-1]


def happened(told: Estimate, causes: Sequence[Cause], by_s: float) -> Happened:
    """Return when something happened: not before its causes, and not after it was heard of.

    Args:
        told: What the host's clock says.
        causes: What it came from, one at least: each had happened before it, without any clock.
        by_s: By when it had happened, as `latest` finds.

    Returns:
        A time whose uncertainty covers every moment that clock, causes and reception leave.
        Where the clock contradicts the others, or was never measured, it covers all between
        them, and says that it does.
    """
    floor_s = max(one.at_s for one in causes)
    first_s = max(one.at_s - one.uncertainty_s for one in causes)
    low_s, high_s, is_bounded = first_s, by_s, told.uncertainty_s is None
    if told.uncertainty_s is not None:
        low_s = max(first_s, told.at_s - told.uncertainty_s)
        high_s = min(by_s, told.at_s + told.uncertainty_s)
        is_bounded = low_s > high_s
    if is_bounded:
        low_s, high_s = first_s, by_s
    # Causes last: where the server's own clock was set back, the order still stands.
    at_s = max(min(told.at_s, by_s), floor_s)
    return Happened(at_s, max(at_s - low_s, high_s - at_s, at_s - high_s), is_bounded)
