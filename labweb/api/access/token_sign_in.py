"""Lets programs in that show the access token of a person."""

from __future__ import annotations

from rest_framework.authentication import BaseAuthentication
from rest_framework.exceptions import APIException
from rest_framework.request import Request

from labweb.accounts import services
from labweb.accounts.selectors import User
from labweb.accounts.selectors.access_tokens import AccessToken, find_token
from labweb.resources import selectors as resource_selectors


class TokenRefusedError(APIException):
    """The token is none, or is valid no longer."""

    status_code = 401
    default_code = "http.token_refused"
    default_detail = (
        "this access token is unknown, expired or revoked: make another one in Settings, and send "
        "it as `Authorization: Bearer TOKEN`"
    )


class TokenAuthentication(BaseAuthentication):
    """Lets a program in that shows the access token of a person.

    Source:
        RFC 6750, section 2.1: a bearer token in the Authorization header.
    """

    def authenticate(self, request: Request) -> tuple[User, AccessToken] | None:
        """Return the person and the token; None: none is shown.

        Raises:
            TokenRefusedError: It is not valid.
        """
        services.acting_token.set(None)
        secret = bearer_of(str(request.headers.get("Authorization", "")))
        if secret is None:
            return None
        token = token_of(secret)
        if token is None:
            raise TokenRefusedError
        services.note_use(token)
        services.acting_token.set({"id": str(token.pk), "name": token.name})
        return token.user, token


def token_of(secret: str) -> AccessToken | None:
    """Return the access token of a secret; None: there is none that is valid in this lab."""
    token = find_token(secret)
    is_ours = token is not None and token.lab_id == resource_selectors.the_lab().pk
    return token if is_ours else None


def caller_of(token: AccessToken) -> str:
    """Return under which name the requests of a token are counted.

    All programs of a person are one caller, and another one than the person at the browser.
    """
    return f"programs:{token.user_id}"


def bearer_of(header: str) -> str | None:
    """Return the secret of an Authorization header; None: it holds no bearer token."""
    kind, _, secret = header.strip().partition(" ")
    return secret.strip() if kind.lower() == "bearer" else None
