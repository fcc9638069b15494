"""Which transactions keep resources locked."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

from labweb.common.database.prepared_queries import (
    prepared_cursor,
)
from labweb.domain.runs.exclusive_use.action_locks import Lock, LockMode

# Written out: it is on the way of every operation of the lab.
_LOCKS = """
SELECT resource_id, mode, transaction_id FROM crutd_resourcelock
WHERE resource_id = ANY(%s) AND released_at IS NULL
"""


def held_locks(ids: Iterable[UUID]) -> list[tuple[Lock, UUID]]:
    """Return live locks on the resources, each with its transaction."""
    with prepared_cursor() as cursor:
        cursor.execute(_LOCKS, [list(ids)])
        return [(Lock(held, LockMode(mode)), owner) for held, mode, owner in cursor.fetchall()]
