"""Who acts on a page of the admin."""

from __future__ import annotations

from django.core.exceptions import PermissionDenied
from django.http import HttpRequest

from labweb.accounts.selectors import User


def actor_of(request: HttpRequest) -> User:
    """Return the person who is signed in.

    Raises:
        PermissionDenied: Nobody is.
    """
    if not isinstance(request.user, User):
        raise PermissionDenied
    return request.user
