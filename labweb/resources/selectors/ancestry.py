"""Up and down the tree in single queries, and the locks that meet on the way."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any
from uuid import UUID

from labweb.common.database.prepared_queries import Question, Written, prepared_cursor, together
from labweb.domain.runs.exclusive_use.run_holds import ROOMY
from labweb.resources.models import Connection as Connection
from labweb.resources.models import Lab as Lab
from labweb.resources.models import Lot as Lot
from labweb.resources.models import Material as Material
from labweb.resources.models import Resource as Resource

_ANCESTORS = """
WITH RECURSIVE up(start, id, parent_id, is_archived, depth) AS (
    SELECT id, id, parent_id, is_archived, 0 FROM resources_resource WHERE id = ANY(%s)
    UNION ALL
    SELECT up.start, r.id, r.parent_id, r.is_archived, up.depth + 1
    FROM resources_resource r JOIN up ON r.id = up.parent_id
)
SELECT start, id, is_archived FROM up WHERE depth > 0 ORDER BY start, depth
"""


_HELD = """
WITH RECURSIVE up(start, id, parent_id, depth) AS (
    SELECT id, id, parent_id, 0 FROM resources_resource
    WHERE id = ANY(ARRAY(SELECT unnest(%s::uuid[])))
    UNION ALL
    SELECT up.start, r.id, r.parent_id, up.depth + 1
    FROM resources_resource r JOIN up ON r.id = up.parent_id
), target AS MATERIALIZED (
    SELECT {columns} FROM resources_resource
    WHERE id = ANY(ARRAY(SELECT unnest(%s::uuid[])))
        AND NOT (id = ANY(ARRAY(SELECT unnest(%s::uuid[])))
            AND kind = ANY(ARRAY(SELECT unnest(%s::text[]))))
    ORDER BY id FOR NO KEY UPDATE NOWAIT
), place AS MATERIALIZED (
    SELECT {columns} FROM resources_resource
    WHERE id = ANY(ARRAY(SELECT unnest(%s::uuid[])))
        AND kind = ANY(ARRAY(SELECT unnest(%s::text[])))
    ORDER BY id FOR SHARE NOWAIT
), above AS MATERIALIZED (
    SELECT up.start, up.depth, r.id, r.parent_id, r.is_archived
    FROM resources_resource r JOIN up ON r.id = up.id
    WHERE up.depth > 0 ORDER BY r.id FOR SHARE OF r NOWAIT
)
SELECT {columns}, (
    SELECT json_agg(json_build_array(a.id, a.parent_id, a.is_archived) ORDER BY a.depth)
    FROM above a WHERE a.start = target.id
) AS above FROM (SELECT * FROM target UNION ALL SELECT * FROM place) AS target ORDER BY target.id
"""
"""The rows as they are when the lock is there; the way up to them as it was when it was read.
A place with room for many is shared: what is put into it changes nothing of the place.

The arrays are taken apart and put together again so that the planner does not count what is in
them: it would believe a plan made for these few the cheaper one, and make it anew each time.
"""


_BELOW = """
WITH RECURSIVE down(id) AS (
    {roots}
    UNION ALL
    SELECT r.id FROM resources_resource r JOIN down ON r.parent_id = down.id
)
SELECT id FROM down
"""


_FEW_BELOW = """
WITH RECURSIVE down(id) AS (
    {roots}
    UNION ALL
    SELECT r.id FROM down CROSS JOIN LATERAL (
        SELECT id FROM resources_resource WHERE parent_id = down.id OFFSET 0
    ) r
)
SELECT id FROM down LIMIT %s
"""
"""By the index alone. Left to itself the planner reads the whole table for each level below a
plate, for it cannot know how few are there; for a whole lab that is the better way."""


_FEW = 500


def ancestors(ids: Iterable[UUID]) -> dict[UUID, tuple[UUID, ...]]:
    """Return everything above each id, nearest first; one query."""
    return {start: tuple(node for node, _ in above) for start, above in _above(ids).items()}


Above = tuple[dict[UUID, tuple[UUID, ...]], set[UUID]]
"""Everything above each id, and the ids that stand in something archived."""


def ancestors_and_archived(ids: Iterable[UUID]) -> Above:
    """Return everything above each id, and the ids that stand in something archived; one query."""
    found = _above(ids)
    archived = {start for start, above in found.items() if any(closed for _, closed in above)}
    return {start: tuple(node for node, _ in above) for start, above in found.items()}, archived


def _above(ids: Iterable[UUID]) -> dict[UUID, list[tuple[UUID, bool]]]:
    wanted = sorted(set(ids))
    found: dict[UUID, list[tuple[UUID, bool]]] = {node: [] for node in wanted}
    with prepared_cursor() as cursor:
        cursor.execute(_ANCESTORS, [wanted])
        for start, node, is_archived in cursor.fetchall():
            found[start].append((node, is_archived))
    return found


def hold(ids: Collection[UUID]) -> tuple[dict[UUID, Resource], Above] | None:
    """Lock nodes for exclusive use, and all above them against it; one query, never waits.

    Whoever locks a plate and whoever locks a well of it then meet at the plate's row, so that
    one of them sees the other's lock.

    Returns:
        The rows in id order, and as `ancestors_and_archived`; None when something was moved
        in between: ask again.

    Raises:
        django.db.OperationalError: Somebody holds one of them right now.
    """
    (found,) = together(asking_hold(ids))
    return held_of(found)


_Held = tuple[Resource, tuple[Any, ...]]


def asking_hold(ids: Collection[UUID], places: Collection[UUID] = ()) -> Question[_Held]:
    """Return what locks them so, to be asked with what is to be read under the locks.

    Args:
        ids: What is locked.
        places: Those that something is only put into or taken from: shared where there is room
            for many.
    """
    wanted, shared, kinds = sorted(ids), sorted(places), sorted(ROOMY)
    return _HOLD.asking([wanted, wanted, shared, kinds, shared, kinds])


def held_of(held: Sequence[_Held]) -> tuple[dict[UUID, Resource], Above] | None:
    """Return what `hold` does, from what that has found."""
    rows = {row.id: row for row, _ in held}
    above: dict[UUID, tuple[UUID, ...]] = {}
    archived = set()
    for row, (levels,) in held:
        expected, way = row.parent_id, []
        for node, parent, is_archived in levels or ():
            if expected != UUID(node):
                return None
            way.append(expected)
            expected = None if parent is None else UUID(parent)
            if is_archived:
                archived.add(row.id)
        if expected is not None:
            return None
        above[row.id] = tuple(way)
    return rows, (above, archived)


_HOLD = Written(Resource, _HELD)


class Below:
    """Everything below some roots, and these; one query, or two when they are many.

    Args:
        roots: SQL that selects the ids of the roots.
    """

    def __init__(self, roots: str) -> None:
        self._few = _FEW_BELOW.format(roots=roots)
        self._all = _BELOW.format(roots=roots)

    def asking(self, values: Sequence[object]) -> Question[UUID]:
        """Return the first query, with the values of the roots' SQL."""
        return Question(self._few, [*values, _FEW + 1], _id_of)

    def all_of(self, found: list[UUID], values: Sequence[object]) -> set[UUID]:
        """Return them all, when the first query has told these."""
        if len(found) > _FEW:
            (found,) = together(Question(self._all, values, _id_of))
        return set(found)


def _id_of(row: Sequence[UUID]) -> UUID:
    return row[0]


_THESE = Below("SELECT id FROM resources_resource WHERE id = ANY(%s)")


def descendants(ids: Iterable[UUID]) -> set[UUID]:
    """Return the ids and everything below them; one query, or two when they are many."""
    roots = [sorted(set(ids))]
    (found,) = together(_THESE.asking(roots))
    return _THESE.all_of(found, roots)
