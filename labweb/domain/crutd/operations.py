"""The five operations as data."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any
from uuid import UUID

import msgspec


class OperationName(StrEnum):
    """The primitive; what an event row shows."""

    CREATE = "create"
    READ = "read"
    UPDATE = "update"
    TRANSFER = "transfer"
    DELETE = "delete"


class Create(msgspec.Struct, frozen=True, tag="create", tag_field="op", kw_only=True):
    """Put a new resource into the tree. Its pose is unknown until confirmed."""

    resource_id: UUID
    parent_id: UUID
    key: str
    name: str
    kind: str
    config: dict[str, Any] = msgspec.field(default_factory=dict)


class Read(msgspec.Struct, frozen=True, tag="read", tag_field="op", kw_only=True):
    """Observe statuses of a device. Moves nothing; the reading is kept with the event."""

    device_id: UUID
    statuses: tuple[str, ...] = ()


class Update(msgspec.Struct, frozen=True, tag="update", tag_field="op", kw_only=True):
    """Set fields of a resource's `data`, alone or coupled to a device action."""

    resource_id: UUID
    data: dict[str, Any]


class TransferLiquid(
    msgspec.Struct, frozen=True, tag="transfer_liquid", tag_field="op", kw_only=True
):
    """Move liquid from one vessel to another; a syringe is a vessel."""

    source_id: UUID
    target_id: UUID
    amount_nl: int


class TransferResource(
    msgspec.Struct, frozen=True, tag="transfer_resource", tag_field="op", kw_only=True
):
    """Carry a resource, with all that stands in it, to another place."""

    resource_id: UUID
    from_id: UUID
    to_id: UUID


class Delete(msgspec.Struct, frozen=True, tag="delete", tag_field="op", kw_only=True):
    """Take a resource out of service into the Archive; nothing is erased."""

    resource_id: UUID
    archive_id: UUID


Operation = Create | Read | Update | TransferLiquid | TransferResource | Delete

_NAMES: dict[type, OperationName] = {
    Create: OperationName.CREATE,
    Read: OperationName.READ,
    Update: OperationName.UPDATE,
    TransferLiquid: OperationName.TRANSFER,
    TransferResource: OperationName.TRANSFER,
    Delete: OperationName.DELETE,
}


def name_of(operation: Operation) -> OperationName:
    """Return which of the five the operation is."""
    return _NAMES[type(operation)]


def touched_ids(operation: Operation) -> tuple[UUID, ...]:
    """Return the resources whose state the operation reads or changes, in id order."""
    match operation:
        case Create():
            ids = {operation.parent_id}
        case Read():
            ids = {operation.device_id}
        case Update():
            ids = {operation.resource_id}
        case TransferLiquid():
            ids = {operation.source_id, operation.target_id}
        case TransferResource():
            ids = {operation.resource_id, operation.from_id, operation.to_id}
        case _:
            ids = {operation.resource_id, operation.archive_id}
    return tuple(sorted(ids))


@dataclass(frozen=True, slots=True)
class Reservation:
    """An amount promised on both sides before anything moves; its lots are not known yet."""

    debit: str
    credit: str
    amount_nl: int = 0
    amount_ug: int = 0


def reservations(operation: Operation) -> tuple[Reservation, ...]:
    """Return what an operation reserves while it is under way."""
    match operation:
        case TransferLiquid():
            source, target = str(operation.source_id), str(operation.target_id)
            return (Reservation(source, target, amount_nl=operation.amount_nl),)
        case _:
            return ()


def subjects_of(operation: Operation) -> tuple[tuple[UUID, str], ...]:
    """Return the resources that an event of the operation concerns, each with its role."""
    match operation:
        case TransferLiquid():
            return ((operation.source_id, "source"), (operation.target_id, "target"))
        case TransferResource():
            return (
                (operation.resource_id, "subject"),
                (operation.from_id, "source"),
                (operation.to_id, "target"),
            )
        case Read():
            return ()
        case _:
            return ((operation.resource_id, "subject"),)


def to_json(operation: Operation) -> dict[str, Any]:
    """Render as plain data."""
    plain: dict[str, Any] = msgspec.to_builtins(operation)
    return plain


def from_json(value: Any) -> Operation:  # noqa: ANN401 - hostile until parsed
    """Read an operation from plain data.

    Raises:
        msgspec.ValidationError: It is none of the six shapes.
    """
    operation: Operation = msgspec.convert(value, Operation)
    return operation
