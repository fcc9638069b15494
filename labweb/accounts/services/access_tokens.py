"""Writes of access tokens."""

from __future__ import annotations

import secrets
from datetime import timedelta
from uuid import UUID

from django.db.transaction import atomic

from labweb.accounts.models import AccessToken, User
from labweb.accounts.selectors.access_tokens import PREFIX, hash_of, valid_tokens
from labweb.accounts.services.audit_trail import write_audit
from labweb.common.clock import now
from labweb.domain.approvals.access_tokens import AccessScope, check_wanted
from labweb.domain.errors import ForbiddenError, NotFoundError

_SECRET_BYTES = 32
_NOTED_EVERY = timedelta(minutes=1)


@atomic
def make_token(
    user: User, *, lab_id: UUID, name: str, scope: AccessScope, days: int
) -> tuple[AccessToken, str]:
    """Make an access token.

    Args:
        user: In whose name it acts.
        lab_id: The only lab that it opens.
        name: What the person calls it; another valid token of theirs has another name.
        scope: How far it reaches.
        days: For how many days it is valid.

    Returns:
        The token, and its secret, which is nowhere else.

    Raises:
        DefinitionError: The name is empty or too long, or the days are not 1 to 366.
        StateError: There is a valid token of that name, or there are too many.

    Effect:
        On the record only.
    """
    called = name.strip()
    User.objects.select_for_update(no_key=True).get(pk=user.pk)
    valid = valid_tokens().filter(user=user, lab_id=lab_id)
    check_wanted(called, days, valid.values_list("name", flat=True))
    secret = PREFIX + secrets.token_urlsafe(_SECRET_BYTES)
    at = now()
    row = AccessToken.objects.create(
        user=user,
        lab_id=lab_id,
        name=called,
        scope=scope.value,
        secret_hash=hash_of(secret),
        created_at=at,
        expires_at=at + timedelta(days=days),
    )
    detail = {"name": called, "scope": scope.value, "days": days}
    write_audit("token.make", str(row.pk), actor=user, detail=detail)
    return row, secret


@atomic
def revoke_token(lab_id: UUID, token_id: UUID, *, actor: User, is_admin: bool) -> None:
    """Revoke an access token: from now on it opens nothing.

    Args:
        lab_id: The lab that it opens.
        token_id: Which one.
        actor: Who revokes it: its owner, or an admin.
        is_admin: The actor may revoke the tokens of others.

    Raises:
        NotFoundError: The lab has no such token.
        ForbiddenError: It is not the actor's, who is no admin.

    Effect:
        On the record only. What was started with it goes on.
    """
    rows = AccessToken.objects.select_for_update(no_key=True).filter(lab_id=lab_id, pk=token_id)
    row = rows.first()
    if not is_admin and (row is None or row.user_id != actor.pk):
        text = "this is no token of yours: its owner or an admin revokes it"
        raise ForbiddenError(text, code="token.of_another")
    if row is None:
        raise NotFoundError(f"there is no token {token_id}", code="token.not_found")
    if row.revoked_at is None:
        _revoke(row, actor)


def revoke_all(user: User, *, actor: User | None) -> None:
    """Revoke every valid access token of a person.

    Effect:
        On the record only.
    """
    for row in valid_tokens().filter(user=user):
        _revoke(row, actor)


def _revoke(row: AccessToken, actor: User | None) -> None:
    row.revoked_at = now()
    row.save(update_fields=["revoked_at"])
    detail = {"name": row.name, "owner": str(row.user_id)}
    write_audit("token.revoke", str(row.pk), actor=actor, detail=detail)


def note_use(token: AccessToken) -> None:
    """Note that a token was used; once a minute is enough."""
    at = now()
    if token.used_at is None or at - token.used_at >= _NOTED_EVERY:
        AccessToken.objects.filter(pk=token.pk).update(used_at=at)
