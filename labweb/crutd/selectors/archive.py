"""Where what is in the Archive stood before."""

from __future__ import annotations

from typing import Any
from uuid import UUID

import msgspec

from labweb.crutd.models import Event
from labweb.crutd.selectors.history_replay import replayed
from labweb.domain.crutd import operations
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Resource


def with_former_place(operation: operations.Operation) -> operations.Operation:
    """Return a delete with where the thing stands, and a restore with where it stood.

    Any other operation is as it was. Where nobody knows, so is a restore: it is refused then.
    """
    if not isinstance(operation, operations.Delete | operations.Restore):
        return operation
    row = resource_selectors.rows([operation.resource_id]).first()
    if row is None or row.parent_id is None:
        return operation
    if isinstance(operation, operations.Delete):
        return msgspec.structs.replace(operation, from_id=row.parent_id, pose=row.pose)
    wanted = operation.to_id
    former = _former_place(row) if row.is_archived else None
    to_id = former[0] if former is not None and wanted is msgspec.UNSET else wanted
    is_back = former is not None and former[0] == to_id
    return msgspec.structs.replace(
        operation,
        from_id=row.parent_id if operation.from_id is msgspec.UNSET else operation.from_id,
        to_id=to_id,
        pose=former[1] if former is not None and is_back else None,
    )


def _former_place(row: Resource) -> tuple[UUID, dict[str, Any] | None] | None:
    """Return that in which a thing stood before it was archived, and its pose there."""
    events = Event.objects.filter(
        subjects__resource=row, body__change__archived__contains=[str(row.pk)]
    )
    last = events.filter(state=TransactionState.COMMITTED.value).order_by("-seq").first()
    return None if last is None else place_before(row, last)


def place_before(row: Resource, last: Event) -> tuple[UUID, dict[str, Any] | None] | None:
    """Return the same by the event that archived it, or where that is older, by those before."""
    told = operations.from_json(last.body["operation"])
    if isinstance(told, operations.Delete) and isinstance(told.from_id, UUID):
        return told.from_id, told.pose
    # It was archived before deletes wrote this down: the events before it tell the same.
    node = replayed(row.lab, up_to=last.seq - 1).nodes.get(row.pk)
    if node is None or node.parent_id is None:
        return None
    return node.parent_id, None if node.pose is None else dict(node.pose)
