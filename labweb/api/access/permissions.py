"""Who may call at all; what they may touch is decided by the services."""

from __future__ import annotations

from rest_framework.permissions import BasePermission
from rest_framework.request import Request

from labweb.accounts import selectors as account_selectors
from labweb.accounts.selectors import User
from labweb.common.database import sessions
from labweb.domain.errors import ForbiddenError


class SignedIn(BasePermission):
    """Any active user that has signed in with a password of their own, and was granted a role.

    A view whose attribute `signs` names a method wants the password again, unless it was typed
    in the last minutes: `signs = {"post"}`.
    """

    def has_permission(self, request: Request, view: object) -> bool:
        """Tell whether somebody is signed in.

        Raises:
            ForbiddenError: They have no role anywhere, somebody else knows their password, or
                they have to type it again first.
        """
        user = request.user
        if not isinstance(user, User) or not user.is_active:
            return False
        if user.password_from == User.PasswordFrom.ADMIN:
            text = "somebody else has set your password: change it first"
            raise ForbiddenError(text, code="session.password_due")
        if not account_selectors.has_role(user):
            text = "you were granted no role in this lab: ask an admin for one"
            raise ForbiddenError(text, code="http.no_role")
        check_signature(request, getattr(view, "signs", frozenset()))
        return True


def check_signature(request: Request, signs: frozenset[str]) -> None:
    """Refuse an act that is signed, unless the password was typed in the last minutes.

    Raises:
        ForbiddenError: It was not; nothing was done.
    """
    if (request.method or "").lower() in signs and not sessions.is_confirmed(request.session):
        text = "this act is signed: type your password again"
        raise ForbiddenError(text, code="session.confirm")
