"""What stands in the place to which an operation brings something."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from uuid import UUID

import msgspec

from labweb.domain.crutd import operations
from labweb.domain.crutd.snapshot import ResourceState
from labweb.domain.resources.placement import is_bounded
from labweb.resources.selectors.occupants import places_of


def with_place(
    operation: operations.Operation, states: Mapping[UUID, ResourceState]
) -> dict[UUID, ResourceState]:
    """Return the states with what stands where the operation brings something.

    Two queries, where that has a say in what may come: to a bench comes what people bring.
    """
    found = dict(states)
    place_id: UUID | msgspec.UnsetType
    match operation:
        case operations.Create():
            place_id = operation.parent_id
        case operations.TransferResource() | operations.Restore():
            place_id = operation.to_id
        case _:
            return found
    state = found.get(place_id) if isinstance(place_id, UUID) else None
    if state is not None and is_bounded(state.kind):
        place = places_of([state.id])[state.id]
        found[state.id] = replace(state, there=place.there, sites_count=place.sites_count)
    return found
