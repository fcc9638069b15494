"""REST of vessels that go from one edge host's hands into another's."""

from __future__ import annotations

from collections.abc import Collection
from typing import ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request
from rest_framework.response import Response

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.common.answers import NamedRef
from labweb.common.requests import Nothing, body
from labweb.crutd.answers import EventRow
from labweb.crutd.api import Act, HandOperations, OperationCheck, require_act, visible
from labweb.crutd.selectors import Transaction
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd.operations import Disconnect, TransferResource
from labweb.domain.errors import Finding
from labweb.domain.graph.attachments import that_hold
from labweb.domain.resources.placement import PLACES, Place, check_standing
from labweb.domain.runs.exclusive_use.resource_custody import CustodyState
from labweb.enrollment.selectors import EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Resource
from labweb.resources.selectors.occupants import places_of_kinds
from labweb.runs import selectors, services
from labweb.runs.answers.custody import (
    CustodyConnection,
    CustodyDetail,
    CustodyMove,
    HandOverAsked,
    HandOverStanding,
    PlaceChoice,
)
from labweb.runs.selectors import Custody
from labweb.runs.services.connection_removal import check_disconnect, disconnect


class HandOver(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a move to another host."""

    place_id: UUID
    note: str


class Operations(HandOperations):
    """Operations by hand, a transfer between two edge hosts among them."""

    answers: ClassVar = {"post": {201: EventRow, 202: HandOverAsked}}

    def post(self, request: Request) -> Response:
        """Carry it out at once; where two hosts have to agree, ask the first (202)."""
        act = body(request, Act)
        if isinstance(act.operation, TransferResource):
            user = user_of(request)
            require_act(user, act.operation)
            made = services.begin_transfer(act.operation, actor=user, note=act.note)
            if made is not None:
                asked = HandOverStanding(id=made.id, state=CustodyState(made.state))
                return Response(HandOverAsked(handover=asked), status=202)
        return super().post(request)

    def carry_out(self, act: Act, user: User) -> Transaction:
        """Ask the runs, too, before a connection is taken off."""
        if isinstance(act.operation, Disconnect):
            return disconnect(act.operation, actor=user, note=act.note)
        return super().carry_out(act, user)


class OperationsCheck(OperationCheck):
    """What speaks against an operation, runs included."""

    def findings(self, act: Act, user: User) -> list[Finding]:
        """Ask the runs, too, before a connection is taken off."""
        if isinstance(act.operation, Disconnect):
            lab = resource_selectors.the_lab()
            return check_disconnect(act.operation, lab=lab, actor_id=user.pk)
        return super().findings(act, user)


class InWhoseHands(Endpoint):
    """Which host writes a resource's facts, and the move it is on."""

    def get(self, request: Request, resource_id: UUID) -> CustodyDetail:
        """Tell its host, its move if there is one, what it is connected to, and who may act."""
        row = visible(request, resource_id)
        user = user_of(request)
        move = selectors.open_move_of(row.id)
        owner = None if move is not None else selectors.owner_of(row.lab, row.id)
        return CustodyDetail(
            host=_host(owner),
            move=None if move is None else _move(move, request),
            connections=_connections(row.id, request),
            is_allowed=row.id in resource_selectors.allowed_ids(user, Permission.RUN),
            places=_places(row, request),
        )


def _places(row: Resource, request: Request) -> list[PlaceChoice]:
    """Say the places of a kind that takes the resource, each with why there is no room.

    What stands there already is named only where the caller may see it.
    """
    kinds = [name for name, room in PLACES.items() if row.kind in room.takes and name != "archive"]
    seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
    found = places_of_kinds(row.lab, kinds)
    return [
        PlaceChoice(id=place.thing.id, why_not=_why_not(row, place, seen))
        for place in found
        if place.thing.id in seen and place.thing.id != row.id
    ]


def _why_not(row: Resource, place: Place, seen: Collection[UUID]) -> str | None:
    there = [one for one in place.there if one.id != row.id]
    if not (findings := check_standing(row, place.thing, there, place.sites_count)):
        return None
    is_hidden = any(one.id not in seen for one in there)
    return f"there is no room in {place.thing.name}" if is_hidden else findings[0].message


def _connections(resource_id: UUID, request: Request) -> list[CustodyConnection]:
    """Say what keeps a resource where it is; a far end that is hidden stays unnamed."""
    found = that_hold(resource_selectors.attachments_of(resource_id))
    seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
    names = resource_selectors.names(one.other.resource_id for one in found)
    return [
        CustodyConnection(
            key=one.key,
            medium=one.medium,
            to=names[one.other.resource_id] if one.other.resource_id in seen else "",
        )
        for one in found
    ]


def _host(host: EdgeHost | None) -> NamedRef | None:
    return None if host is None else NamedRef(id=host.id, name=host.name)


def _move(move: Custody, request: Request) -> CustodyMove:
    seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
    place = move.place
    is_seen = place is not None and place.id in seen
    return CustodyMove(
        id=move.id,
        state=CustodyState(move.state),
        origin=_host(move.origin),
        target=_host(move.target),
        place=NamedRef(id=place.id, name=place.name) if place and is_seen else None,
        asked_by=None if move.asked_by is None else move.asked_by.printed_name,
        asked_at=move.at,
        released_at=move.released_at,
        is_told=move.state == CustodyState.IN_TRANSIT.value and selectors.is_told(move),
    )


class HandOvers(Endpoint):
    """Move a vessel to a place of another host."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": HandOver}
    statuses: ClassVar = {"post": 201}

    def post(self, request: Request, resource_id: UUID) -> HandOverStanding:
        """Ask its host to let it go."""
        user, wanted = user_of(request), body(request, HandOver)
        resource_selectors.require_seen(user, [resource_id, wanted.place_id])
        made = services.hand_over(resource_id, wanted.place_id, actor=user, note=wanted.note)
        return HandOverStanding(id=made.id, state=CustodyState(made.state))


class Arrival(Endpoint):
    """A vessel in transit is where it was sent."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Nothing}

    def post(self, request: Request, custody_id: UUID) -> HandOverStanding:
        """Tell its new host to take it over."""
        body(request, Nothing)
        user = user_of(request)
        selectors.find_move(custody_id, resource_selectors.allowed_ids(user, Permission.VIEW))
        made = services.confirm_arrival(custody_id, actor=user)
        return HandOverStanding(id=made.id, state=CustodyState(made.state))
