"""Who may call at all; what they may touch is decided by the services."""

from __future__ import annotations

from rest_framework.permissions import BasePermission
from rest_framework.request import Request


class SignedIn(BasePermission):
    """Any active user that has signed in."""

    def has_permission(self, request: Request, _view: object) -> bool:
        """Tell whether somebody is signed in."""
        user = request.user
        return user.is_authenticated and user.is_active
