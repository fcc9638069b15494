"""What runs hold."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from django.db.models import QuerySet

from labweb.common.database.prepared_queries import Question, together
from labweb.crutd.models import RunHold as RunHold
from labweb.domain.runs.exclusive_use.run_holds import UseMode

_HOLDS = """
WITH RECURSIVE wanted(id) AS (
    SELECT unnest(%s::uuid[])
    UNION
    SELECT r.parent_id FROM wanted JOIN resources_resource r ON r.id = wanted.id
    WHERE r.parent_id IS NOT NULL
), held(id, hold_id) AS (
    SELECT resource_id, id FROM crutd_runhold WHERE released_at IS NULL
    UNION ALL
    SELECT r.parent_id, hold_id
    FROM held JOIN resources_resource r ON r.id = held.id WHERE r.parent_id IS NOT NULL
)
SELECT held.id, h.resource_id, h.mode, h.run_id, h.run_number, h.holder_id, h.until_step
FROM held JOIN crutd_runhold h ON h.id = held.hold_id
WHERE held.id IN (SELECT id FROM wanted) ORDER BY h.run_number, h.resource_id
"""
"""As for reservations: what a held thing stands in is used too, wherever it stands by now."""


@dataclass(frozen=True, slots=True)
class HeldAt:
    """How a hold is met at one place of the tree."""

    node_id: UUID
    mode: UseMode
    """`WITHIN` where the held thing stands in this one."""

    resource_id: UUID
    """What is held."""

    run_id: UUID
    run_number: int
    holder_id: UUID
    until_step: int


def asking_holds(ids: Iterable[UUID]) -> Question[tuple[Any, ...]]:
    """Return what finds the holds on resources, on all above them and on all below."""
    return Question(_HOLDS, [list(ids)], tuple)


def holds_at(found: Iterable[tuple[Any, ...]]) -> list[HeldAt]:
    """Return them from what that has found."""
    return [
        HeldAt(
            node_id=node,
            mode=UseMode(mode) if node == resource_id else UseMode.WITHIN,
            resource_id=resource_id,
            run_id=run_id,
            run_number=number,
            holder_id=holder_id,
            until_step=until,
        )
        for node, resource_id, mode, run_id, number, holder_id, until in found
    ]


def holds_on(ids: Iterable[UUID]) -> list[HeldAt]:
    """Return the holds on resources, on all above them and on all below; one query."""
    (found,) = together(asking_holds(ids))
    return holds_at(found)


def holds_of(run_ids: Collection[UUID]) -> QuerySet[RunHold]:
    """Return what runs hold now, with the things."""
    rows = RunHold.objects.filter(run_id__in=run_ids, released_at=None)
    return rows.select_related("resource").order_by("run_number", "resource__name", "id")


def live_on(ids: Collection[UUID]) -> QuerySet[RunHold]:
    """Return the holds on these very resources."""
    rows = RunHold.objects.filter(resource_id__in=ids, released_at=None)
    return rows.order_by("run_number", "id")
