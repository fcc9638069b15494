"""How a resource goes from one host's hands into another's, never into both.

    owned by A ──ask──▶ leaving A ──released by A──▶ in transit ──received by B──▶ owned by B

A host is the single writer of what it owns. In between the server keeps the last state that
the first host wrote. All that stands in a thing goes along with it.

A person carries the thing, and scans it where it arrives. A device that carries it for a run
does so in the hands of its own host: the thing is handed over to that host where it stands,
carried, and handed on where it was put. No hand-over moves anything then.

    owned by A ─▶ owned by the host that carries ─ carried ─▶ owned by B
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import StrEnum
from uuid import UUID

import msgspec

from labweb.domain.canonical_json import canonical
from labweb.domain.errors import StateError
from labweb.domain.messages.commands import ReceiveCommand, Release, ResourceView
from labweb.domain.runs.host_journal.journal_rows import HeldResource, JournalWrite


class CustodyState(StrEnum):
    """In whose hands a resource is."""

    OWNED = "owned"
    LEAVING = "leaving"
    """Its owner was asked to let it go; until it says so, it is still the owner's."""

    IN_TRANSIT = "in_transit"
    """Nobody's but the server's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ResourceCustody:
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


def next_hands(
    owner: UUID | None, wanted: UUID | None, *, gone: Collection[UUID] = ()
) -> UUID | None:
    """Return the host that a thing has to be handed to; None: to nobody.

    Args:
        owner: Host that writes its facts; None: no host does.
        wanted: Host that carries it next, or that has the place where it was put.
        gone: Hosts that were declared lost or revoked: nobody waits for their word.
    """
    if owner is None or wanted is None or owner == wanted:
        return None
    return None if owner in gone or wanted in gone else wanted


def ask(
    custody: ResourceCustody, *, transfer_id: UUID, target: UUID, in_use: Collection[UUID]
) -> ResourceCustody:
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
    custody: ResourceCustody, *, host: UUID, transfer_id: UUID, view: ResourceView
) -> ResourceCustody:
    """Take the word of the owner that it has let a resource go.

    Raises:
        StateError: It is not this host's to let go, or not for this move.
    """
    is_due = custody.state is CustodyState.LEAVING and custody.transfer_id == transfer_id
    if not is_due or custody.owner != host:
        raise StateError("this host lets go what it does not own", code="custody.not_owner")
    return replace(custody, state=CustodyState.IN_TRANSIT, owner=None, view=view)


def after_kept(custody: ResourceCustody, *, host: UUID, transfer_id: UUID) -> ResourceCustody:
    """Take the word of the owner that it cannot let a resource go: nothing has moved."""
    is_due = custody.state is CustodyState.LEAVING and custody.transfer_id == transfer_id
    if not is_due or custody.owner != host:
        return custody
    return replace(custody, state=CustodyState.OWNED, transfer_id=None, target=None)


def after_received(custody: ResourceCustody, *, host: UUID, transfer_id: UUID) -> ResourceCustody:
    """Take the word of the target that it has the resource in its hands.

    Raises:
        StateError: It is not in transit to this host by this move.
    """
    is_due = custody.state is CustodyState.IN_TRANSIT and custody.transfer_id == transfer_id
    if not is_due or custody.target != host:
        raise StateError("this host receives what is not sent to it", code="custody.not_target")
    return ResourceCustody(resource_id=custody.resource_id, state=CustodyState.OWNED, owner=host)


# --- the host's side ----------------------------------------------------------------


def take_release(tx: JournalWrite, release: Release, *, in_use: Collection[UUID]) -> bool:
    """Let a resource go, once for each move; False: the command says nothing new.

    What stands in it goes along, and nothing goes while any of it is in use or in doubt.

    Args:
        tx: The write.
        release: The command, whose signature, host and epoch hold.
        in_use: Resources of this host's actions that have not ended.
    """
    if not tx.is_first_refusal(f"release:{release.transfer_id}"):
        return False
    body = {"transfer_id": str(release.transfer_id), "resource_id": str(release.resource_id)}
    known = _latest(tx, release.resource_id, release.view)
    ids = [release.resource_id, *(part.id for part in release.parts)]
    if known is None or not all(_is_free(tx, one, in_use) for one in ids):
        tx.append("kept", None, {**body, "code": "custody.in_use"})
        return True
    told = {part.id: part for part in release.parts}
    parts = [_latest(tx, part.id, part) for part in release.parts]
    fresh = [one for one in parts if one is not None and one != told[one.id]]
    for one in ids:
        tx.drop_resource(one)
    tx.append("released", None, {**body, "view": _plain(known), "parts": [*map(_plain, fresh)]})
    return True


def _is_free(tx: JournalWrite, resource_id: UUID, in_use: Collection[UUID]) -> bool:
    held = tx.resource(resource_id)
    return resource_id not in in_use and (held is None or held.quarantined_by is None)


def _latest(tx: JournalWrite, resource_id: UUID, told: ResourceView | None) -> ResourceView | None:
    """Return the newer of what this host knows and what the server told."""
    held = tx.resource(resource_id)
    if held is None or (told is not None and told.rev > held.view.rev):
        return told
    return held.view


def _plain(view: ResourceView) -> object:
    return msgspec.json.decode(canonical(view))


def take_receive(tx: JournalWrite, receive: ReceiveCommand) -> bool:
    """Take a resource over with all in it, once for each move; False: nothing new is said."""
    if not tx.is_first_refusal(f"receive:{receive.transfer_id}"):
        return False
    view = msgspec.structs.replace(receive.view, rev=receive.view.rev + 1)
    for one in (view, *receive.parts):
        tx.put_resource(HeldResource(view=one))
    body = {"transfer_id": str(receive.transfer_id), "resource_id": str(view.id)}
    tx.append("received", None, {**body, "rev": view.rev})
    return True
