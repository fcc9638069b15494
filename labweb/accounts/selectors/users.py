"""Reads of users."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

from rest_framework.request import Request

from labweb.accounts.models import User
from labweb.domain.errors import ForbiddenError


def user_by_id(user_id: UUID) -> User | None:
    """Return the user with that id."""
    return User.objects.filter(pk=user_id).first()


def printed_names(ids: Iterable[str]) -> dict[str, str]:
    """Return the name that stands under a decision, by id; one query."""
    rows = User.objects.filter(pk__in=list(ids))
    return {str(row.pk): row.printed_name for row in rows}


def find_user(username: str) -> User | None:
    """Return the user of that name."""
    return User.objects.filter(username=username).first()


def user_of(request: Request) -> User:
    """Return who is signed in.

    Raises:
        ForbiddenError: Nobody is.
    """
    if not isinstance(request.user, User):
        raise ForbiddenError("sign in first", code="http.not_authenticated")
    return request.user
