"""Sign in, sign out, who am I."""

from __future__ import annotations

from typing import Any, ClassVar

import msgspec
from django.contrib.auth import authenticate, login, logout
from django.middleware.csrf import get_token
from rest_framework.authentication import SessionAuthentication
from rest_framework.exceptions import Throttled
from rest_framework.permissions import AllowAny
from rest_framework.request import Request
from rest_framework.response import Response
from rest_framework.views import APIView

from labweb.accounts import selectors as account_selectors
from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.api.sign_in import FORGET_AFTER_S, Place, remember
from labweb.common.requests import body
from labweb.domain.errors import ForbiddenError, NotFoundError
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors as run_selectors


class Credentials(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a sign-in."""

    username: str
    password: str


class Session(APIView):
    """The caller's session."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Credentials}

    permission_classes = (AllowAny,)

    def get(self, request: Request) -> Response:
        """Tell who is signed in, and set the CSRF cookie."""
        get_token(request._request)  # noqa: SLF001 - DRF offers no other way to the cookie
        return Response(_session(request.user))

    def post(self, request: Request) -> Response:
        """Sign in; whoever fails five times at a name from one place waits there five minutes."""
        SessionAuthentication().enforce_csrf(request)
        given = body(request, Credentials)
        place = Place.of(request, given.username)
        if place.is_closed():
            raise Throttled(wait=FORGET_AFTER_S)
        user = authenticate(request, username=given.username, password=given.password)
        if not isinstance(user, User):
            place.count_failure()
            account_services.write_failed_sign_in(
                given.username, address=request.META.get("REMOTE_ADDR", "")
            )
            raise ForbiddenError("the name or the password is wrong", code="session.wrong")
        place.forget_failures()
        login(request._request, user)  # noqa: SLF001 - DRF offers no other way to the session
        account_services.write_audit("session.open", str(user.pk), actor=user)
        answer = Response(_session(user))
        remember(answer, request, given.username)
        return answer

    def delete(self, request: Request) -> Response:
        """Sign out."""
        if isinstance(request.user, User):
            account_services.write_audit("session.close", str(request.user.pk), actor=request.user)
        logout(request._request)  # noqa: SLF001 - DRF offers no other way to the session
        return Response(status=204)


def _session(user: object) -> dict[str, Any]:
    if not isinstance(user, User) or not user.is_active:
        return {"user": None, "lab": None}
    try:
        lab = run_selectors.lab_summary(resource_selectors.the_lab())
    except NotFoundError:
        lab = None
    name = user.printed_name
    return {
        "user": {
            "id": str(user.pk),
            "username": user.username,
            "name": name,
            "initials": "".join(part[0] for part in name.split()[:2]).upper(),
            "roles": account_selectors.roles_of(user),
            "permissions": sorted(p.value for p in account_selectors.permissions_of(user)),
        },
        "lab": lab,
    }
