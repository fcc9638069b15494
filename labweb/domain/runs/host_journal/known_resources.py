"""Resources as a host knows them: taken over from the server, settled by the host."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from uuid import UUID

import msgspec

from labweb.domain.crutd.ledger import vessel_of
from labweb.domain.crutd.operations import Create
from labweb.domain.crutd.settlement import Change, ResourceState, Snapshot
from labweb.domain.messages.commands import ResourceView, StandingView
from labweb.domain.resources.contents_by_lot import LotId, add, remove
from labweb.domain.resources.placement import PlacedThing
from labweb.domain.runs.host_journal.journal_rows import HeldResource, JournalWrite

DEEPEST_TREE = 64


def stale_resource(tx: JournalWrite, views: Sequence[ResourceView]) -> ResourceView | None:
    """Find a resource of which the server knows less than this host; None: it is up to date."""
    for view in views:
        held = tx.resource(view.id)
        if held is not None and view.rev < held.view.rev:
            return held.view
    return None


def adopt(tx: JournalWrite, views: Sequence[ResourceView]) -> None:
    """Take over what the server says.

    The server changes a resource only while nothing is open on it, so its newer revision
    is the truth, a lifted quarantine included; at the same revision a quarantine stays.
    """
    for view in views:
        held = tx.resource(view.id)
        is_newer = held is None or view.rev > held.view.rev
        quarantined_by = None if held is None or is_newer else held.quarantined_by
        tx.put_resource(HeldResource(view=view, quarantined_by=quarantined_by))


def snapshot(tx: JournalWrite, ids: Iterable[UUID]) -> Snapshot:
    """Return what a decision needs to know of these resources; unknown ones are left out."""
    found = {}
    for resource_id in ids:
        held = tx.resource(resource_id)
        if held is not None:
            found[resource_id] = _to_state(tx, held)
    return found


def apply_change(tx: JournalWrite, change: Change, action_id: UUID) -> dict[str, int]:
    """Write a settled change and lift its action's quarantine; return the new revisions.

    A change that quarantines closes its resources anew, in the same write.
    """
    held: dict[UUID, HeldResource] = {}
    for one in tx.quarantined_for(action_id):
        held[one.view.id] = HeldResource(view=one.view)
    _pour(tx, change, held)
    for resource_id, data in change.data.items():
        view = _held(tx, held, resource_id).view
        fresh = msgspec.structs.replace(view, data={**view.data, **data})
        held[resource_id] = HeldResource(view=fresh)
    for resource_id, parent_id in change.moves.items():
        view = _held(tx, held, resource_id).view
        _make_room(tx, view, parent_id)
        held[resource_id] = HeldResource(view=msgspec.structs.replace(view, parent_id=parent_id))
    for resource_id in change.archived:
        view = _held(tx, held, resource_id).view
        held[resource_id] = HeldResource(view=msgspec.structs.replace(view, is_archived=True))
    for resource_id in change.quarantined:
        view = _held(tx, held, resource_id).view
        held[resource_id] = HeldResource(view=view, quarantined_by=str(action_id))
    for operation in change.created:
        held[operation.resource_id] = HeldResource(view=_created(operation))
    return {str(i): _keep(tx, held[i]) for i in sorted(held)}


def _make_room(tx: JournalWrite, moved: ResourceView, place_id: UUID) -> None:
    """Write down what stands in the place that a thing leaves, and in that to which it comes."""
    thing = StandingView(id=moved.id, name=moved.name, kind=moved.kind)
    for one, comes in ((moved.parent_id, []), (place_id, [thing])):
        place = None if one is None else tx.resource(one)
        if place is not None:
            there = [other for other in place.view.there if other.id != moved.id]
            view = msgspec.structs.replace(place.view, there=[*there, *comes])
            tx.put_resource(HeldResource(view=view, quarantined_by=place.quarantined_by))


def _pour(tx: JournalWrite, change: Change, held: dict[UUID, HeldResource]) -> None:
    """Pour what is counted by volume; of solids and gases a host keeps no record."""
    for posting in change.postings:
        parts = {posting.lot: posting.amount_nl}
        if not posting.amount_nl:
            continue
        for account, pour in ((posting.debit, remove), (posting.credit, add)):
            vessel = vessel_of(account)
            if vessel is not None:
                view = _held(tx, held, vessel).view
                filled = _filled(view, pour(_contents(view), parts))
                held[vessel] = HeldResource(view=filled)


def _held(tx: JournalWrite, held: dict[UUID, HeldResource], resource_id: UUID) -> HeldResource:
    if resource_id not in held:
        found = tx.resource(resource_id)
        if found is None:
            raise KeyError(resource_id)
        held[resource_id] = found
    return held[resource_id]


def _keep(tx: JournalWrite, held: HeldResource) -> int:
    rev = held.view.rev + 1
    view = msgspec.structs.replace(held.view, rev=rev)
    tx.put_resource(HeldResource(view=view, quarantined_by=held.quarantined_by))
    return rev


def _contents(view: ResourceView) -> dict[LotId, int]:
    return {LotId(lot): amount for lot, amount in view.contents.items()}


def _filled(view: ResourceView, contents: dict[LotId, int]) -> ResourceView:
    plain = {str(lot): amount for lot, amount in contents.items()}
    return msgspec.structs.replace(view, contents=plain)


def _created(operation: Create) -> ResourceView:
    return ResourceView(
        id=operation.resource_id,
        name=operation.name,
        kind=operation.kind,
        rev=0,
        parent_id=operation.parent_id,
    )


def _to_state(tx: JournalWrite, held: HeldResource) -> ResourceState:
    view = held.view
    return ResourceState(
        id=view.id,
        name=view.name,
        kind=view.kind,
        parent_id=view.parent_id,
        contents=_contents(view),
        capacity_nl=view.capacity_nl,
        dead_volume_nl=view.dead_volume_nl,
        data=view.data,
        quarantined_by=held.quarantined_by,
        is_archived=view.is_archived,
        there=tuple(PlacedThing(one.id, one.name, one.kind) for one in view.there),
        sites_count=view.sites_count,
        knows_masses=False,
        ancestor_ids=_ancestors(tx, view.parent_id),
    )


def _ancestors(tx: JournalWrite, parent_id: UUID | None) -> tuple[UUID, ...]:
    found: list[UUID] = []
    while parent_id is not None and parent_id not in found and len(found) < DEEPEST_TREE:
        found.append(parent_id)
        held = tx.resource(parent_id)
        parent_id = None if held is None else held.view.parent_id
    return tuple(found)
