"""Access tokens: for programs that act in the name of a person."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request

from labweb.accounts import services
from labweb.accounts.answers import AccessTokenList, AccessTokenRow, NewAccessToken
from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, access_tokens, user_of
from labweb.common.clock import now
from labweb.common.lists import STANDING
from labweb.common.requests import Parameter, body, one_of
from labweb.domain.approvals.access_tokens import AccessScope, is_valid
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import ForbiddenError
from labweb.resources import selectors as resource_selectors


class MakeAccessToken(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a new access token."""

    name: str
    scope: AccessScope
    days: int
    """For how many days it is valid, 1 to 366."""


class AccessTokens(Endpoint):
    """The access tokens of this lab."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": MakeAccessToken}
    queries: ClassVar[Mapping[str, Parameter]] = {
        "of": one_of(("me", "all"), "Whose tokens; `all` is for admins."),
        **STANDING.parameters,
    }
    statuses: ClassVar[Mapping[str, int]] = {"post": 201}
    signs = frozenset({"post"})

    def get(self, request: Request) -> AccessTokenList:
        """List the caller's tokens, those too that are valid no longer; an admin may see all."""
        user, lab = user_of(request), resource_selectors.the_lab()
        rows = access_tokens.tokens_of_lab(lab.pk)
        if request.query_params.get("of") != "all":
            rows = rows.filter(user=user)
        elif not _is_admin(user):
            text = "only an admin sees the tokens of others"
            raise ForbiddenError(text, code="token.of_another")
        found, following = STANDING.of_rows(request, rows, "-created_at", "id")
        return AccessTokenList(tokens=[_row(row) for row in found], next=following)

    def post(self, request: Request) -> NewAccessToken:
        """Make a token; its secret is in this answer alone."""
        wanted = body(request, MakeAccessToken)
        row, secret = services.make_token(
            user_of(request),
            lab_id=resource_selectors.the_lab().pk,
            name=wanted.name,
            scope=wanted.scope,
            days=wanted.days,
        )
        return NewAccessToken(token=_row(row), secret=secret)


class OneAccessToken(Endpoint):
    """One access token."""

    def delete(self, request: Request, access_id: UUID) -> None:
        """Revoke it: from now on it opens nothing, and what was started with it goes on."""
        user, lab = user_of(request), resource_selectors.the_lab()
        services.revoke_token(lab.pk, access_id, actor=user, is_admin=_is_admin(user))


def _is_admin(user: User) -> bool:
    return Permission.ADMIT in resource_selectors.permissions_on_all(user)


def _row(row: access_tokens.AccessToken) -> AccessTokenRow:
    return AccessTokenRow(
        id=row.pk,
        name=row.name,
        owner=row.user.printed_name,
        scope=AccessScope(row.scope),
        created_at=row.created_at,
        expires_at=row.expires_at,
        revoked_at=row.revoked_at,
        used_at=row.used_at,
        is_valid=is_valid(row.expires_at, row.revoked_at, now()),
    )
