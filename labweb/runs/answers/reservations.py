"""What the endpoints of reservations answer with."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from labweb.common.answers import ApiAnswer, NamedRef


class ReservationRow(ApiAnswer):
    """Exclusive use of a resource in the near future; the time ends it."""

    id: UUID
    resource: NamedRef
    holder: str
    is_own: bool
    may_end: bool
    """The caller may end it before its time."""

    reason: str
    made_at: datetime
    expires_at: datetime
    ended_at: datetime | None
    """Null: nobody ended it before its time."""


class ReservationsMade(ApiAnswer):
    """What was reserved together."""

    reservations: list[ReservationRow]


class ReservationList(ApiAnswer):
    """A page of reservations that hold now."""

    reservations: list[ReservationRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class ReservationsOfResource(ApiAnswer):
    """What is reserved of a resource and of what it stands in."""

    is_allowed: bool
    """The caller may reserve it."""

    reservations: list[ReservationRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""
