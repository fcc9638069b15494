"""Reads of access tokens."""

from __future__ import annotations

import hashlib
from uuid import UUID

from django.db.models import QuerySet

from labweb.accounts.models import AccessToken as AccessToken
from labweb.accounts.models import User
from labweb.common.clock import now

PREFIX = "labweb_"
"""What every secret begins with, so that one finds those that were lost."""

_LONGEST = 200


def hash_of(secret: str) -> str:
    """Return what is kept of a secret."""
    return hashlib.sha256(secret.encode(errors="replace")).hexdigest()


def find_token(secret: str) -> AccessToken | None:
    """Return the valid token of a secret with its user; None: there is none.

    A secret has 256 random bits, so that its hash is looked up as it is.
    """
    if not secret.startswith(PREFIX) or len(secret) > _LONGEST:
        return None
    rows = AccessToken.objects.select_related("user").filter(
        secret_hash=hash_of(secret), revoked_at=None, expires_at__gt=now(), user__is_active=True
    )
    return rows.exclude(user__password_from=User.PasswordFrom.ADMIN).first()


def tokens_of_lab(lab_id: UUID) -> QuerySet[AccessToken]:
    """Return the tokens of a lab with their owners."""
    return AccessToken.objects.select_related("user").filter(lab_id=lab_id)


def live_tokens(user: User, lab_id: UUID) -> QuerySet[AccessToken]:
    """Return the tokens of a person that are valid now."""
    rows = tokens_of_lab(lab_id).filter(user=user)
    return rows.filter(revoked_at=None, expires_at__gt=now())
