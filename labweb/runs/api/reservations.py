"""REST of reservations: exclusive use in the near future."""

from __future__ import annotations

from datetime import timedelta
from typing import Annotated, ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.common.answers import NamedRef
from labweb.common.lists import HISTORY
from labweb.common.requests import Nothing, body
from labweb.crutd.api import visible
from labweb.crutd.selectors import reservations as reserved
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import NotFoundError
from labweb.domain.runs.exclusive_use.reservations import LONGEST_REASON, MOST
from labweb.resources import selectors as resource_selectors
from labweb.runs import services
from labweb.runs.answers.reservations import (
    ReservationList,
    ReservationRow,
    ReservationsMade,
    ReservationsOfResource,
)
from labweb.runs.services import reservations

_MOST_MINUTES = 1_000_000_000
"""No limit of a reservation, which is refused by its rule: more is no span of time."""


class WantedReservation(msgspec.Struct, forbid_unknown_fields=True):
    """What to reserve, for how long, and what for."""

    resource_ids: Annotated[list[UUID], msgspec.Meta(max_length=10 * MOST)]
    minutes: Annotated[int, msgspec.Meta(ge=-_MOST_MINUTES, le=_MOST_MINUTES)]
    reason: Annotated[str, msgspec.Meta(max_length=10 * LONGEST_REASON)]


class Reservations(Endpoint):
    """What is reserved now."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": WantedReservation}
    statuses: ClassVar = {"post": 201}

    queries = HISTORY.parameters

    def get(self, request: Request) -> ReservationList:
        """List the reservations that hold now, of resources the caller may see, oldest first."""
        user = user_of(request)
        seen = resource_selectors.allowed_ids(user, Permission.VIEW)
        rows = reserved.reservations_on(resource_selectors.the_lab(), seen)
        found, following = HISTORY.of_rows(request, rows, "made_at", "id")
        return ReservationList(
            reservations=[_reservation(row, user) for row in found], next=following
        )

    def post(self, request: Request) -> ReservationsMade:
        """Reserve all of the resources for the caller, or none (423 with each reason)."""
        wanted = body(request, WantedReservation)
        user = user_of(request)
        ids = set(wanted.resource_ids[: MOST + 1])
        resource_selectors.require_seen(user, ids)
        made = services.reserve(
            ids, actor=user, lasts=timedelta(minutes=wanted.minutes), reason=wanted.reason
        )
        found = [reserved.find_reservation(row.pk) for row in made]
        return ReservationsMade(reservations=[_reservation(row, user) for row in found])


class ResourceReservations(Endpoint):
    """What is reserved of one resource."""

    queries = HISTORY.parameters

    def get(self, request: Request, resource_id: UUID) -> ReservationsOfResource:
        """List the reservations of it and of what it stands in; may the caller reserve it?"""
        row = visible(request, resource_id)
        user = user_of(request)
        above = resource_selectors.ancestors([row.id])[row.id]
        seen = resource_selectors.allowed_ids(user, Permission.VIEW)
        rows = reserved.reservations_on(row.lab, {row.id, *above} & seen)
        found, following = HISTORY.of_rows(request, rows, "made_at", "id")
        return ReservationsOfResource(
            is_allowed=row.id in resource_selectors.allowed_ids(user, Permission.RUN),
            reservations=[_reservation(one, user) for one in found],
            next=following,
        )


class EndReservation(Endpoint):
    """The end of a reservation before its time."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Nothing}

    def post(self, request: Request, reservation_id: UUID) -> ReservationRow:
        """End it now; one that is over stays as it is."""
        body(request, Nothing)
        user = user_of(request)
        row = reserved.find_reservation(reservation_id)
        if row.resource_id not in resource_selectors.allowed_ids(user, Permission.VIEW):
            raise NotFoundError(f"no reservation {reservation_id}", code="reservation.not_found")
        services.end_reservation(row, actor=user)
        return _reservation(reserved.find_reservation(reservation_id), user)


def _reservation(row: reserved.ResourceReservation, user: User) -> ReservationRow:
    return ReservationRow(
        id=row.pk,
        resource=NamedRef(id=row.resource_id, name=row.resource.name),
        holder=row.holder.printed_name,
        is_own=row.holder_id == user.pk,
        may_end=reservations.may_end(row, user),
        reason=row.reason,
        made_at=row.made_at,
        expires_at=row.expires_at,
        ended_at=row.ended_at,
    )
