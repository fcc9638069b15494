"""Sign in, sign out, who am I."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import msgspec
from django.contrib.auth import authenticate, login, logout, update_session_auth_hash
from django.middleware.csrf import get_token
from rest_framework.authentication import SessionAuthentication
from rest_framework.exceptions import ErrorDetail, Throttled
from rest_framework.permissions import AllowAny, IsAuthenticated
from rest_framework.request import Request
from rest_framework.response import Response

from labweb.accounts import selectors as account_selectors
from labweb.accounts import services as account_services
from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User
from labweb.api.access.password_attempts import AttemptOrigin, closed_words, remember
from labweb.api.answers.session import (
    OpenSession,
    PasswordConfirmed,
    PasswordMaker,
    SignedInUser,
)
from labweb.common.database import sessions
from labweb.common.requests import body
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import ForbiddenError, NotFoundError
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors as run_selectors


class Credentials(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a sign-in."""

    username: str
    password: str


class Session(Endpoint):
    """The caller's session."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Credentials}
    harmless: ClassVar[Mapping[str, str]] = {
        "post": "who signs in twice is signed in; nobody is known yet whose key it could be",
        "delete": "who signs out twice is signed out",
    }
    answers: ClassVar = {"post": {200: OpenSession}}

    permission_classes = (AllowAny,)

    def get(self, request: Request) -> OpenSession:
        """Tell who is signed in, and set the CSRF cookie."""
        get_token(request._request)  # noqa: SLF001 - DRF offers no other way to the cookie
        return _session(request.user)

    def post(self, request: Request) -> Response:
        """Sign in; whoever fails five times at a name from one place waits there five minutes."""
        SessionAuthentication().enforce_csrf(request)
        given = body(request, Credentials)
        place = _open_place(request, given.username)
        user = authenticate(request, username=given.username, password=given.password)
        if not isinstance(user, User):
            place.count_failure()
            account_services.write_failed_sign_in(
                given.username, address=request.META.get("REMOTE_ADDR", "")
            )
            raise ForbiddenError("the name or the password is wrong", code="session.wrong")
        place.forget_failures()
        login(request._request, user)  # noqa: SLF001 - DRF offers no other way to the session
        sessions.begin(request.session)
        account_services.write_audit("session.open", str(user.pk), actor=user)
        answer = Response(_session(user))
        remember(answer, request, given.username)
        return answer

    def delete(self, request: Request) -> None:
        """Sign out."""
        if isinstance(request.user, User):
            account_services.write_audit("session.close", str(request.user.pk), actor=request.user)
        logout(request._request)  # noqa: SLF001 - DRF offers no other way to the session


class Words(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a change of the own password."""

    old: str
    new: str


class Password(Endpoint):
    """The caller's own password."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Words}
    harmless: ClassVar[Mapping[str, str]] = {
        "post": "a second time the present password is another one, and is refused"
    }

    permission_classes = (IsAuthenticated,)

    def post(self, request: Request) -> OpenSession:
        """Choose a new one; every other session of the caller ends."""
        user, given = account_selectors.user_of(request), body(request, Words)
        place = _open_place(request, user.username)
        try:
            row = account_services.change_password(user, old=given.old, new=given.new)
        except ForbiddenError:
            place.count_failure()
            raise
        update_session_auth_hash(request._request, row)  # noqa: SLF001 - as above
        sessions.begin(request.session)
        return _session(row)


class Again(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a password that is typed again."""

    password: str


class Confirm(Endpoint):
    """The caller's password, typed again for what is signed."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Again}
    harmless: ClassVar[Mapping[str, str]] = {
        "post": "it notes when the password was typed, and does nothing else"
    }

    permission_classes = (IsAuthenticated,)

    def post(self, request: Request) -> PasswordConfirmed:
        """Take the password; acts are signed with it for five minutes."""
        user, given = account_selectors.user_of(request), body(request, Again)
        place = _open_place(request, user.username)
        if not user.check_password(given.password):
            place.count_failure()
            address = request.META.get("REMOTE_ADDR", "")
            account_services.write_failed_sign_in(user.username, address=address)
            raise ForbiddenError("the password is wrong", code="session.wrong")
        sessions.confirm(request.session)
        return PasswordConfirmed(holds_s=sessions.CONFIRMED_FOR_S)


class Awake(Endpoint):
    """Somebody is there."""

    harmless: ClassVar[Mapping[str, str]] = {
        "post": "it notes when somebody was there, and does nothing else"
    }
    permission_classes = (IsAuthenticated,)

    def post(self, _request: Request) -> None:
        """Note that the person who is signed in has used the page."""


class Closed(Throttled):
    """A wrong password was typed too often from where one signs in."""

    def __init__(self, wait_s: int) -> None:
        super().__init__()
        self.wait: float = wait_s
        self.detail = ErrorDetail(closed_words(wait_s), "throttled")


def _open_place(request: Request, username: str) -> AttemptOrigin:
    """Return from where a password is tried, unless it was wrong too often there."""
    place = AttemptOrigin.of(request, username)
    wait_s = place.closed_for_s()
    if wait_s:
        raise Closed(wait_s)
    return place


def _session(user: object) -> OpenSession:
    if not isinstance(user, User) or not user.is_active:
        return OpenSession(user=None, lab=None)
    on_lab: frozenset[Permission] = frozenset()
    try:
        lab = run_selectors.lab_summary(resource_selectors.the_lab())
        on_lab = resource_selectors.permissions_on_all(user)
    except NotFoundError:
        lab = None
    name = user.printed_name
    return OpenSession(
        user=SignedInUser(
            id=user.id,
            username=user.username,
            name=name,
            initials="".join(part[0] for part in name.split()[:2]).upper(),
            roles=account_selectors.roles_of(user),
            password_from=msgspec.convert(str(user.password_from), PasswordMaker),
            permissions=sorted(account_selectors.permissions_of(user)),
            lab_permissions=sorted(on_lab),
        ),
        lab=lab,
    )
