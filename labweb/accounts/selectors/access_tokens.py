"""Reads of access tokens."""

from __future__ import annotations

import hashlib
from uuid import UUID

from django.db.models import QuerySet

from labweb.accounts.models import AccessToken as AccessToken
from labweb.accounts.models import User
from labweb.common.clock import now

PREFIX = "labweb_"
"""What every secret begins with, so that one that was lost can be searched for."""

_LONGEST = 200


def hash_of(secret: str) -> str:
    """Return what is kept of a secret."""
    return hashlib.sha256(secret.encode(errors="replace")).hexdigest()


def valid_tokens() -> QuerySet[AccessToken]:
    """Return the tokens that are valid now, as `domain.approvals.tokens.is_valid` says it."""
    return AccessToken.objects.filter(revoked_at=None, expires_at__gt=now())


def find_token(secret: str) -> AccessToken | None:
    """Return the valid token of a secret with its owner; None: there is none.

    A secret has 256 random bits, so that its hash is looked up as it is. The tokens of a person
    who may not sign in, or whose password somebody else has set, open nothing.
    """
    if not secret.startswith(PREFIX) or len(secret) > _LONGEST:
        return None
    rows = valid_tokens().select_related("user").filter(secret_hash=hash_of(secret))
    owned = rows.filter(user__is_active=True)
    return owned.exclude(user__password_from=User.PasswordFrom.ADMIN).first()


def tokens_of_lab(lab_id: UUID) -> QuerySet[AccessToken]:
    """Return the tokens of a lab with their owners, those too that are valid no longer."""
    return AccessToken.objects.select_related("user").filter(lab_id=lab_id)
