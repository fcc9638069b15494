"""Who has reserved what."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any
from uuid import UUID

from django.db.models import QuerySet

from labweb.common.clock import now
from labweb.common.database.prepared_queries import Question, together
from labweb.crutd.models import ResourceReservation as ResourceReservation
from labweb.domain.errors import NotFoundError
from labweb.domain.runs.exclusive_use.action_locks import Lock, LockMode
from labweb.domain.runs.exclusive_use.reservations import ReservedLock
from labweb.resources.selectors import Lab

_USES = """
WITH RECURSIVE wanted(id) AS (
    SELECT unnest(%s::uuid[])
    UNION
    SELECT r.parent_id FROM wanted JOIN resources_resource r ON r.id = wanted.id
    WHERE r.parent_id IS NOT NULL
), reserved(id, start, reservation_id, made_at, is_own) AS (
    SELECT resource_id, resource_id, id, made_at, holder_id IS NOT DISTINCT FROM %s
    FROM crutd_resourcereservation WHERE ended_at IS NULL AND expires_at > %s
    UNION ALL
    SELECT r.parent_id, start, reservation_id, made_at, is_own
    FROM reserved JOIN resources_resource r ON r.id = reserved.id WHERE r.parent_id IS NOT NULL
)
SELECT resource_id, mode, transaction_id, NULL, NULL FROM crutd_resourcelock
WHERE resource_id = ANY(ARRAY(SELECT id FROM wanted)) AND released_at IS NULL
UNION ALL
SELECT id, CASE WHEN id = start THEN 'X' ELSE 'IX' END, reservation_id, made_at, is_own
FROM reserved WHERE id IN (SELECT id FROM wanted)
"""
"""What stands above a reserved thing is taken in intention, wherever it stands by now."""


Uses = tuple[list[tuple[Lock, UUID]], list[ReservedLock]]
"""Live locks, each with its transaction, and reservations."""


def uses(ids: Iterable[UUID], actor_id: UUID | None) -> Uses:
    """Return locks and reservations of resources and of all above them; one query.

    Args:
        ids: The resources.
        actor_id: Who asks: whose own reservations these are.
    """
    (found,) = together(asking_uses(ids, actor_id))
    return uses_of(found)


def asking_uses(ids: Iterable[UUID], actor_id: UUID | None) -> Question[tuple[Any, ...]]:
    """Return what finds these, to be asked with others."""
    return Question(_USES, [list(ids), actor_id, now()], tuple)


def uses_of(found: Iterable[tuple[Any, ...]]) -> Uses:
    """Return them from what that has found."""
    held: list[tuple[Lock, UUID]] = []
    claims: list[ReservedLock] = []
    for node, mode, owner, made_at, is_own in found:
        lock = Lock(node, LockMode(mode))
        if made_at is None:
            held.append((lock, owner))
        else:
            claims.append(
                ReservedLock(lock=lock, reservation_id=owner, made_at=made_at, is_own=is_own)
            )
    return held, claims


def live_reservations(lab: Lab) -> QuerySet[ResourceReservation]:
    """Reservations of a lab that hold now, the oldest first, with holder and resource."""
    rows = ResourceReservation.objects.filter(resource__lab=lab, ended_at=None)
    rows = rows.filter(expires_at__gt=now())
    return rows.select_related("holder", "resource__lab").order_by("made_at", "id")


def is_any_live(besides_id: UUID | None) -> bool:
    """Say whether anybody else has reserved anything now."""
    (found,) = together(asking_any_live(besides_id))
    return bool(found)


def asking_any_live(besides_id: UUID | None) -> Question[tuple[Any, ...]]:
    """Return what finds one reservation that anybody else has now."""
    return Question(_ANY_LIVE, [now(), besides_id], tuple)


_ANY_LIVE = """
SELECT 1 FROM crutd_resourcereservation
WHERE ended_at IS NULL AND expires_at > %s AND holder_id IS DISTINCT FROM %s LIMIT 1
"""


def reservations_on(lab: Lab, ids: Collection[UUID]) -> QuerySet[ResourceReservation]:
    """Reservations that hold now of any of these resources."""
    return live_reservations(lab).filter(resource_id__in=ids)


def find_reservation(reservation_id: UUID) -> ResourceReservation:
    """Return a reservation with its holder and resource.

    Raises:
        NotFoundError: There is none.
    """
    rows = ResourceReservation.objects.select_related("holder", "resource__lab")
    row = rows.filter(pk=reservation_id).first()
    if row is None:
        raise NotFoundError(f"no reservation {reservation_id}", code="reservation.not_found")
    return row
