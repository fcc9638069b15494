"""How a resource goes from one host's hands into another's, never into both.

    owned by A ──ask──▶ leaving A ──released by A──▶ in transit ──received by B──▶ owned by B

A host is the single writer of what it owns. In between the server keeps the last state that
the first host wrote; a person carries the thing, and scans it where it arrives.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import StrEnum
from uuid import UUID

import msgspec

from labweb.domain.errors import StateError
from labweb.domain.messages import Receive, Release, ResourceView, canonical
from labweb.domain.runs.journal import HeldResource, JournalWrite


class CustodyState(StrEnum):
    """In whose hands a resource is."""

    OWNED = "owned"
    LEAVING = "leaving"
    """Its owner was asked to let it go; until it says so, it is still the owner's."""

    IN_TRANSIT = "in_transit"
    """Nobody's but the server's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Custody:
    """One resource as the server sees it."""

    resource_id: UUID
    state: CustodyState
    owner: UUID | None
    """Host that writes its facts; None while it is in transit."""

    transfer_id: UUID | None = None
    target: UUID | None = None
    """Host that it goes to."""

    view: ResourceView | None = None
    """What the last owner knew of it, for the next."""


def ask(custody: Custody, *, transfer_id: UUID, target: UUID, in_use: Collection[UUID]) -> Custody:
    """Begin to move a resource to another host.

    Args:
        custody: Where it is.
        transfer_id: Names this move for ever.
        target: Host it goes to.
        in_use: Resources that an action holds which has not ended, or whose outcome nobody
            knows.

    Raises:
        StateError: It moves already, is there already, or is in use. Nothing changed.
    """
    if custody.state is not CustodyState.OWNED:
        raise StateError("it is on its way already", code="custody.moving")
    if custody.owner == target:
        raise StateError("it is there already", code="custody.same_host")
    if custody.resource_id in in_use:
        raise StateError("an action that has not ended uses it", code="custody.in_use")
    return replace(custody, state=CustodyState.LEAVING, transfer_id=transfer_id, target=target)


def after_released(
    custody: Custody, *, host: UUID, transfer_id: UUID, view: ResourceView
) -> Custody:
    """Take the word of the owner that it has let a resource go.

    Raises:
        StateError: It is not this host's to let go, or not for this move.
    """
    is_due = custody.state is CustodyState.LEAVING and custody.transfer_id == transfer_id
    if not is_due or custody.owner != host:
        raise StateError("this host lets go what it does not own", code="custody.not_owner")
    return replace(custody, state=CustodyState.IN_TRANSIT, owner=None, view=view)


def after_kept(custody: Custody, *, host: UUID, transfer_id: UUID) -> Custody:
    """Take the word of the owner that it cannot let a resource go: nothing has moved."""
    is_due = custody.state is CustodyState.LEAVING and custody.transfer_id == transfer_id
    if not is_due or custody.owner != host:
        return custody
    return replace(custody, state=CustodyState.OWNED, transfer_id=None, target=None)


def after_received(custody: Custody, *, host: UUID, transfer_id: UUID) -> Custody:
    """Take the word of the target that it has the resource in its hands.

    Raises:
        StateError: It is not in transit to this host by this move.
    """
    is_due = custody.state is CustodyState.IN_TRANSIT and custody.transfer_id == transfer_id
    if not is_due or custody.target != host:
        raise StateError("this host receives what is not sent to it", code="custody.not_target")
    return Custody(resource_id=custody.resource_id, state=CustodyState.OWNED, owner=host)


# --- the host's side ----------------------------------------------------------------


def take_release(tx: JournalWrite, release: Release, *, in_use: Collection[UUID]) -> bool:
    """Let a resource go, once for each move; False: the command says nothing new.

    Args:
        tx: The write.
        release: The command, whose signature, host and epoch hold.
        in_use: Resources of this host's actions that have not ended.
    """
    if not tx.is_first_refusal(f"release:{release.transfer_id}"):
        return False
    held = tx.resource(release.resource_id)
    is_free = held is None or held.quarantined_by is None
    body = {"transfer_id": str(release.transfer_id), "resource_id": str(release.resource_id)}
    known = release.view if held is None else held.view
    if known is None or not is_free or release.resource_id in in_use:
        tx.append("kept", None, {**body, "code": "custody.in_use"})
        return True
    if release.view is not None and release.view.rev > known.rev:
        known = release.view
    tx.drop_resource(release.resource_id)
    view = msgspec.json.decode(canonical(known))
    tx.append("released", None, {**body, "view": view})
    return True


def take_receive(tx: JournalWrite, receive: Receive) -> bool:
    """Take a resource over, once for each move; False: the command says nothing new."""
    if not tx.is_first_refusal(f"receive:{receive.transfer_id}"):
        return False
    view = msgspec.structs.replace(receive.view, rev=receive.view.rev + 1)
    tx.put_resource(HeldResource(view=view))
    body = {"transfer_id": str(receive.transfer_id), "resource_id": str(view.id)}
    tx.append("received", None, {**body, "rev": view.rev})
    return True
