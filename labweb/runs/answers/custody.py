"""What the endpoints of vessels between two hosts answer with."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from msgspec import field

from labweb.common.answers import ApiAnswer, NamedRef
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.runs.exclusive_use.resource_custody import CustodyState


class CustodyMove(ApiAnswer):
    """A move of a vessel from one host's hands into another's."""

    id: UUID
    state: CustodyState
    origin: NamedRef | None = field(name="from")
    target: NamedRef | None = field(name="to")
    place: NamedRef | None
    """Null: there is none, or the caller may not see it."""

    asked_by: str | None
    asked_at: datetime
    released_at: datetime | None
    is_told: bool
    """The new host was told to take it over."""


class CustodyConnection(ApiAnswer):
    """What keeps a vessel where it is."""

    key: str
    medium: Medium
    to: str
    """Empty: the caller may not see its far end."""


class PlaceChoice(ApiAnswer):
    """A place of a kind that takes the vessel."""

    id: UUID
    why_not: str | None
    """Why there is no room for it now; null: there is."""


class CustodyDetail(ApiAnswer):
    """Which host writes a vessel's facts, and the move that it is on."""

    host: NamedRef | None
    move: CustodyMove | None
    connections: list[CustodyConnection]
    """It is not carried before these are off."""

    is_allowed: bool
    """The caller may move it."""

    places: list[PlaceChoice]


class HandOverStanding(ApiAnswer):
    """How far a move to another host has come."""

    id: UUID
    state: CustodyState


class HandOverAsked(ApiAnswer):
    """An operation by hand for which two hosts have to agree: the first was asked."""

    handover: HandOverStanding
