"""The five operations as data, each in the shapes it comes in."""

from __future__ import annotations

from datetime import date
from enum import StrEnum
from typing import Annotated, Any
from uuid import UUID

import msgspec
from msgspec import Meta

from labweb.domain.crutd.ledger import Account
from labweb.domain.crutd.operation_parts import Amount as Amount
from labweb.domain.crutd.operation_parts import Difference as Difference
from labweb.domain.crutd.operation_parts import Joint as Joint
from labweb.domain.crutd.operation_parts import Name as Name
from labweb.domain.crutd.operation_parts import Portion as Portion
from labweb.domain.crutd.operation_parts import Product as Product
from labweb.domain.crutd.operation_parts import ReactantShare as ReactantShare
from labweb.domain.crutd.operation_parts import Text as Text
from labweb.domain.resources.contents_by_lot import Phase


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
    key: Name
    name: Name
    kind: str
    config: dict[str, Any] = msgspec.field(default_factory=dict)


class Read(msgspec.Struct, frozen=True, tag="read", tag_field="op", kw_only=True):
    """Observe statuses of a device. Moves nothing; the reading is kept with the event."""

    device_id: UUID
    statuses: tuple[str, ...] = ()
    sample_id: UUID | msgspec.UnsetType = msgspec.UNSET
    """What is measured, where it is another resource than the device: a tube in its bore."""


class Update(
    msgspec.Struct, frozen=True, tag="update", tag_field="op", kw_only=True, omit_defaults=True
):
    """Set fields of a resource's `data`, alone or coupled to a device action."""

    resource_id: UUID
    data: dict[str, Any]
    needs_empty: bool = False
    """The act drives out what the resource holds: a syringe that looks for its zero."""

    sample_id: UUID | msgspec.UnsetType = msgspec.UNSET
    """What is measured by the act, where it is another resource: what stands in its cell."""


class TransferLiquid(
    msgspec.Struct,
    frozen=True,
    tag="transfer_liquid",
    tag_field="op",
    kw_only=True,
    omit_defaults=True,
):
    """Move liquid from one vessel to another; a syringe is a vessel."""

    source_id: UUID
    target_id: UUID
    amount_nl: Difference
    parts_nl: dict[str, Amount] = msgspec.field(default_factory=dict)
    """What goes over of each lot, where somebody has said which lots lie in the layer that is
    drawn, or boil off. Empty: the source is well mixed, and each lot gives its share."""

    keeps: tuple[UUID, ...] = ()
    """Solid lots that stay, as somebody has said: on a filter, or where only vapour leaves."""

    carries_ug: dict[str, Amount] = msgspec.field(default_factory=dict)
    """Solid lots that go along, dissolved or suspended, and how much of each, as somebody has
    said; what is left of them stays. A host, which keeps no record of solids, books the same."""


class TransferResource(
    msgspec.Struct, frozen=True, tag="transfer_resource", tag_field="op", kw_only=True
):
    """Carry a resource, with all that stands in it, to another place."""

    resource_id: UUID
    from_id: UUID
    to_id: UUID


class Delete(
    msgspec.Struct, frozen=True, tag="delete", tag_field="op", kw_only=True, omit_defaults=True
):
    """Take a resource out of service into the Archive; nothing is erased."""

    resource_id: UUID
    archive_id: UUID
    from_id: UUID | msgspec.UnsetType = msgspec.UNSET
    """Where it stood, for a restore. The server writes it down."""

    pose: dict[str, Any] | None = None
    """Its pose there; None: unknown. The server writes it down."""


class Restore(
    msgspec.Struct, frozen=True, tag="restore", tag_field="op", kw_only=True, omit_defaults=True
):
    """Take a resource out of the Archive, back into service."""

    resource_id: UUID
    from_id: UUID | msgspec.UnsetType = msgspec.UNSET
    """The Archive it stands in; absent: the server looks."""

    to_id: UUID | msgspec.UnsetType = msgspec.UNSET
    """Where it goes; absent: where it stood when it was archived."""

    pose: dict[str, Any] | None = None
    """Its pose where it stood before, if it goes there. The server writes it down."""


class TransferMass(
    msgspec.Struct,
    frozen=True,
    tag="transfer_mass",
    tag_field="op",
    kw_only=True,
    omit_defaults=True,
):
    """Move a solid or a gas from one vessel to another, by mass."""

    source_id: UUID
    target_id: UUID
    amount_ug: Amount
    phase: Phase
    """What the person means to move; a vessel that holds anything else is refused."""

    parts_ug: dict[str, Amount] = msgspec.field(default_factory=dict)
    """What goes over of each lot, as a plan writes it: a host, which keeps no record of solids,
    books the same as the server. Empty: each lot gives its share."""


class Receive(msgspec.Struct, frozen=True, tag="receive", tag_field="op", kw_only=True):
    """Take a delivery in: a new lot, out of RECEIPT into one vessel or several."""

    lot_id: UUID
    material_id: UUID
    key: Name
    phase: Phase
    portions: Annotated[tuple[Portion, ...], Meta(min_length=1, max_length=1000)]
    supplier: Text = ""
    number: Text = ""
    purity: Text = ""
    expires_on: date | None = None


class Correct(msgspec.Struct, frozen=True, tag="correct", tag_field="op", kw_only=True):
    """Take stock of a vessel: what it holds from now on is what was measured, lot by lot.

    A lot that is not listed is not there any more. The differences go to the account, or
    come out of it. It ends the quarantine of the vessel.
    """

    resource_id: UUID
    account: Account
    reason: Text
    measured_nl: dict[str, Amount] = msgspec.field(default_factory=dict)
    measured_ug: dict[str, Amount] = msgspec.field(default_factory=dict)


class Dispose(msgspec.Struct, frozen=True, tag="dispose", tag_field="op", kw_only=True):
    """Pour a vessel's contents away, all of them or a part of its liquid or its solids."""

    resource_id: UUID
    amount_nl: Amount | None = None
    amount_ug: Amount | None = None


class React(msgspec.Struct, frozen=True, tag="react", tag_field="op", kw_only=True):
    """Record a reaction in a vessel: reactants go into REACTION, products come out of it.

    Masses on both sides are equal: `residue_ug` is what was made beside the products, which
    stays in REACTION.
    """

    resource_id: UUID
    reactants: Annotated[tuple[ReactantShare, ...], Meta(min_length=1, max_length=100)]
    products: Annotated[tuple[Product, ...], Meta(min_length=1, max_length=100)]
    reason: Text
    residue_ug: Amount = 0
    basis: UUID | msgspec.UnsetType = msgspec.UNSET
    """Lot of which one mole gives at most one mole of the first product: the yield is on it."""


class Refit(msgspec.Struct, frozen=True, tag="refit", tag_field="op", kw_only=True):
    """Give a device the parts of another version of its driver. Moves no matter.

    Parts that go are kept in the Archive with all that stands in them, which is nothing but places
    of their own; those that the device had before come back out of it.
    """

    device_id: UUID
    """The device, which is no resource itself."""

    anchor_id: UUID
    """A part that the device has now: beside it the others stand."""

    digest: Text
    """Of the version of the driver that it is for."""

    added: tuple[Create, ...] = ()
    """Parents first."""

    back: dict[UUID, UUID] = msgspec.field(default_factory=dict)
    """Resource → in what it stands again."""

    gone: tuple[UUID, ...] = ()
    archive_id: UUID | msgspec.UnsetType = msgspec.UNSET
    """Needed where parts go or come back."""

    configs: dict[UUID, dict[str, Any]] = msgspec.field(default_factory=dict)
    """The whole new configuration, by resource."""

    joined: tuple[Joint, ...] = ()
    parted: tuple[UUID, ...] = ()
    """Connections that are no more."""


class Disconnect(msgspec.Struct, frozen=True, tag="disconnect", tag_field="op", kw_only=True):
    """Take a connection off the physical graph. Moves no matter: nothing may be in it."""

    connection_id: UUID
    key: Name
    source_id: UUID
    source_port: Text
    target_id: UUID
    target_port: Text
    medium: Text
    """All as the person saw it: what has become otherwise is not taken off."""

    is_seen_empty: bool = False
    """A person has looked, and nothing is in the tube. No record tells what a tube holds."""


Operation = (
    Create
    | Read
    | Update
    | TransferLiquid
    | TransferMass
    | TransferResource
    | Delete
    | Restore
    | Receive
    | Correct
    | Dispose
    | React
    | Refit
    | Disconnect
)

HandOperation = (
    Create
    | TransferLiquid
    | TransferMass
    | TransferResource
    | Delete
    | Restore
    | Receive
    | Correct
    | Dispose
    | React
    | Disconnect
)
"""What a person may do by hand and tell of."""

_NAMES: dict[type, OperationName] = {
    Create: OperationName.CREATE,
    Read: OperationName.READ,
    Update: OperationName.UPDATE,
    TransferLiquid: OperationName.TRANSFER,
    TransferResource: OperationName.TRANSFER,
    TransferMass: OperationName.TRANSFER,
    Delete: OperationName.DELETE,
    Restore: OperationName.TRANSFER,
    Receive: OperationName.CREATE,
    Correct: OperationName.UPDATE,
    Dispose: OperationName.TRANSFER,
    React: OperationName.UPDATE,
    Refit: OperationName.UPDATE,
    Disconnect: OperationName.DELETE,
}


def name_of(operation: Operation) -> OperationName:
    """Return which of the five the operation is."""
    return _NAMES[type(operation)]


def is_told_by_server(operation: Operation) -> bool:
    """Tell whether an operation says what the server alone writes down: where a thing stood."""
    match operation:
        case Delete():
            return operation.from_id is not msgspec.UNSET or operation.pose is not None
        case Restore():
            return operation.pose is not None
        case _:
            return False


def touched_ids(operation: Operation) -> tuple[UUID, ...]:
    """Return the resources whose state the operation reads or changes, in id order."""
    match operation:
        case Create():
            ids = {operation.parent_id}
        case Read():
            ids = {operation.device_id}
        case Update() | Correct() | Dispose() | React():
            ids = {operation.resource_id}
        case TransferLiquid() | TransferMass() | Disconnect():
            ids = {operation.source_id, operation.target_id}
        case TransferResource() | Restore():
            ends = (operation.from_id, operation.to_id)
            ids = {operation.resource_id, *(one for one in ends if isinstance(one, UUID))}
        case Receive():
            ids = {portion.resource_id for portion in operation.portions}
        case Refit():
            ids = {operation.anchor_id, *operation.gone, *operation.back, *operation.configs}
            ids |= {one for one in (operation.archive_id,) if isinstance(one, UUID)}
        case _:
            ids = {operation.resource_id, operation.archive_id}
    return tuple(sorted(ids))


def subjects_of(operation: Operation) -> tuple[tuple[UUID, str], ...]:
    """Return the resources that an event of the operation concerns, each with its role."""
    match operation:
        case TransferLiquid() | TransferMass() | Disconnect():
            return ((operation.source_id, "source"), (operation.target_id, "target"))
        case TransferResource() | Restore():
            ends = ((operation.from_id, "source"), (operation.to_id, "target"))
            known = tuple((one, role) for one, role in ends if isinstance(one, UUID))
            return ((operation.resource_id, "subject"), *known)
        case Receive():
            return tuple((vessel, "target") for vessel in touched_ids(operation))
        case Dispose():
            return ((operation.resource_id, "source"),)
        case Read():
            return ((operation.device_id, "subject"),)
        case Refit():
            added = {create.resource_id for create in operation.added}
            ids = {*added, *operation.gone, *operation.back, *operation.configs}
            return tuple((one, "subject") for one in sorted(ids or {operation.anchor_id}))
        case _:
            return ((operation.resource_id, "subject"),)


def sample_of(operation: Operation) -> UUID | None:
    """Return the resource that an operation measures; None: it does not say."""
    match operation:
        case Read() | Update():
            return None if operation.sample_id is msgspec.UNSET else operation.sample_id
        case Dispose():
            return operation.resource_id
        case _:
            return None


def to_json(operation: Operation) -> dict[str, Any]:
    """Render as plain data."""
    plain: dict[str, Any] = msgspec.to_builtins(operation)
    return plain


def from_json(value: Any) -> Operation:  # noqa: ANN401 - hostile until parsed
    """Read an operation from plain data.

    Raises:
        msgspec.ValidationError: It is none of the shapes above.
    """
    operation: Operation = msgspec.convert(value, Operation)
    return operation
