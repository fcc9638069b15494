"""What the endpoints of people answer with."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from labweb.common.answers import ApiAnswer
from labweb.domain.approvals.access_tokens import AccessScope


class AccessTokenRow(ApiAnswer):
    """An access token, without its secret."""

    id: UUID
    name: str
    owner: str
    """Printed name of the person in whose name it acts."""

    scope: AccessScope
    created_at: datetime
    expires_at: datetime
    revoked_at: datetime | None
    used_at: datetime | None
    """When it was last used, to the minute; null: never."""

    is_valid: bool


class AccessTokenList(ApiAnswer):
    """A page of access tokens, the latest first."""

    tokens: list[AccessTokenRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class NewAccessToken(ApiAnswer):
    """An access token that was just made."""

    token: AccessTokenRow
    secret: str
    """It is shown this once: the server keeps its hash alone."""
