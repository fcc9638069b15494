"""When a thing was at a place, from the moves of it and of all it stood in."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

_DEEPEST = 1000


@dataclass(frozen=True, slots=True, order=True)
class PlaceMove:
    """One change of place."""

    at: datetime
    resource: str
    source: str
    """Empty: nobody wrote down where it had stood."""

    target: str


@dataclass(frozen=True, slots=True)
class Stay:
    """A time without interruption at a place."""

    since: datetime | None
    """None: as far back as the record goes."""

    until: datetime | None
    """None: it is still there."""


Moves = Callable[[Collection[str]], Sequence[PlaceMove]]
"""Given resources, return every move of each."""

Parents = Callable[[Collection[str]], Mapping[str, str | None]]
"""Given resources, return where each stands now."""


def stays_at(resource: str, places: Collection[str], moves: Moves, parents: Parents) -> list[Stay]:
    """Find when a resource stood in one of the places, be it deep inside.

    Args:
        resource: What is asked for.
        places: Where; the resource itself counts as being there always.
        moves: Asked once for each resource.
        parents: Asked once for each resource.

    Returns:
        The stays in order of time; two never touch.
    """
    by_resource, now = _gathered(resource, moves, parents)
    times = sorted({move.at for rows in by_resource.values() for move in rows})
    edges: list[datetime | None] = [None, *times]
    found: list[Stay] = []
    for place, since in enumerate(edges):
        until = edges[place + 1] if place + 1 < len(edges) else None
        if not _is_inside(resource, frozenset(places), since, by_resource, now):
            continue
        if found and found[-1].until == since and since is not None:
            found[-1] = Stay(found[-1].since, until)
        else:
            found.append(Stay(since, until))
    return found


def _gathered(
    resource: str, moves: Moves, parents: Parents
) -> tuple[dict[str, list[PlaceMove]], dict[str, str | None]]:
    """Read the moves of the resource and of whatever it ever stood in."""
    by_resource: dict[str, list[PlaceMove]] = {}
    now: dict[str, str | None] = {}
    asked: set[str] = set()
    wanted = {resource}
    while wanted:
        asked |= wanted
        for move in sorted(moves(sorted(wanted))):
            by_resource.setdefault(move.resource, []).append(move)
        now.update(parents(sorted(wanted)))
        touched = {n for row in wanted for n in _ever_in(by_resource.get(row, ()), now.get(row))}
        wanted = touched - asked
    return by_resource, now


def _ever_in(moves: Iterable[PlaceMove], parent: str | None) -> set[str]:
    found = {end for move in moves for end in (move.source, move.target)} - {""}
    return found if parent is None else found | {parent}


def _is_inside(
    resource: str,
    places: frozenset[str],
    at: datetime | None,
    moves: Mapping[str, Sequence[PlaceMove]],
    now: Mapping[str, str | None],
) -> bool:
    node: str | None = resource
    for _ in range(_DEEPEST):
        if node is None or node in places:
            break
        node = _parent_at(moves.get(node, ()), now.get(node), at)
    return node is not None and node in places


def _parent_at(moves: Sequence[PlaceMove], now: str | None, at: datetime | None) -> str | None:
    """Return where something stood just after a time; None as time is the beginning."""
    if not moves:
        return now
    done = [move for move in moves if at is not None and move.at <= at]
    return done[-1].target if done else moves[0].source or None


def clipped(
    stays: Iterable[Stay], since: datetime, until: datetime
) -> list[tuple[datetime, datetime]]:
    """Return the parts of the stays within a window."""
    parts = [(max(s.since or since, since), min(s.until or until, until)) for s in stays]
    return [(begin, end) for begin, end in parts if begin < end]
