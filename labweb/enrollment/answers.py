"""What the endpoints of machines that ask to become hosts answer with."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal
from uuid import UUID

from labweb.common.answers import ApiAnswer, KeyedRef, NamedRef

JoinRequestState = Literal["waiting", "admitted", "rejected", "expired"]
JoinTokenState = Literal["open", "used", "withdrawn", "expired"]


class JoinTokenRow(ApiAnswer):
    """Leave for one machine to ask, without its secret."""

    id: UUID
    name: str
    """Name that the host is to have; empty: the machine says one."""

    created_at: datetime
    expires_at: datetime
    used_at: datetime | None
    withdrawn_at: datetime | None
    state: JoinTokenState


class JoinTokenList(ApiAnswer):
    """A page of tokens."""

    tokens: list[JoinTokenRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class JoinTokenMade(JoinTokenRow):
    """A token that was just made; this answer alone holds its secret."""

    token: str
    command: str
    """What is typed on the machine."""


class JoinRequestRow(ApiAnswer):
    """A machine that asks to become a host."""

    id: UUID
    name: str
    address: str
    facts: dict[str, Any]
    """What it says of itself."""

    asked_at: datetime
    state: JoinRequestState
    reason: str
    host_id: UUID | None
    """The host that it has become."""

    claims_to_be: NamedRef | None


class JoinRequestList(ApiAnswer):
    """A page of machines that asked."""

    requests: list[JoinRequestRow]
    door: str
    """Address at which machines ask."""

    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class JoinAdmission(ApiAnswer):
    """A machine was admitted."""

    host: KeyedRef
