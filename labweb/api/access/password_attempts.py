"""How often a wrong password may be tried, so that nobody is locked out by a stranger.

Failures are counted by name and place together. A place is the address that a request comes from;
a browser in which somebody has signed in under the name before is a place of its own, known by a
cookie that the server signed. So whoever tries passwords closes the name for the own address
alone, and not for a browser that is known, even at that address.

Source:
    OWASP, "Slow Down Online Guessing Attacks with Device Cookies".
"""

from __future__ import annotations

import math
import secrets
from dataclasses import dataclass
from hashlib import sha256

from django.conf import settings
from django.core import signing
from django.core.cache import cache
from django.http import HttpRequest
from rest_framework.request import Request
from rest_framework.response import Response

from labweb.api.outermost_layer import name_of
from labweb.common.clock import now

MOST_FAILURES = 5
"""At one name from one place."""

MOST_OF_AN_ADDRESS = 20
"""At all names, from browsers that are not known."""

FORGET_AFTER_S = 300
KNOWN_FOR_S = 90 * 24 * 3600
_COOKIE = "labweb_known_"
_SALT = "labweb.sign-in.known"
_LONGEST_COOKIE = 500


@dataclass(frozen=True, slots=True)
class AttemptOrigin:
    """From where somebody signs in under a name."""

    keys: dict[str, int]
    """Counter in the cache → how many failures close it; the first is of name and place."""

    @classmethod
    def of(cls, request: Request | HttpRequest, username: str) -> AttemptOrigin:
        """Return the place of a request."""
        known = _known_browser(request, username)
        if known:
            return cls({_key(username, f"browser:{known}"): MOST_FAILURES})
        address = name_of(str(request.META.get("REMOTE_ADDR", "")))
        return cls({_key(username, address): MOST_FAILURES, _key("", address): MOST_OF_AN_ADDRESS})

    def closed_for_s(self) -> int:
        """Return for how long it is closed after too many failures; 0: it is open."""
        at_s = now().timestamp()
        ends = [
            cache.get(f"{key}:ends") or at_s
            for key, most in self.keys.items()
            if (cache.get(key) or 0) >= most
        ]
        return max((max(1, math.ceil(end - at_s)) for end in ends), default=0)

    def count_failure(self) -> None:
        """Note a wrong password."""
        ends = now().timestamp() + FORGET_AFTER_S
        for key in self.keys:
            if cache.add(key, 0, FORGET_AFTER_S):
                cache.set(f"{key}:ends", ends, FORGET_AFTER_S)
            cache.incr(key)

    def forget_failures(self) -> None:
        """Note a right one: what failed before under this name was a mistake."""
        cache.delete(next(iter(self.keys)))


def closed_words(closed_for_s: int) -> str:
    """Say that a place is closed, and when it opens.

    Example:
        >>> closed_words(205)
        'a wrong password was typed too often: try again in 4 minutes'
    """
    minutes = math.ceil(closed_for_s / 60)
    when = "a minute" if minutes == 1 else f"{minutes} minutes"
    return f"a wrong password was typed too often: try again in {when}"


def remember(answer: Response, request: Request, username: str) -> None:
    """Let the browser be known from now on as one in which this name has signed in."""
    number = _known_browser(request, username) or secrets.token_urlsafe(16)
    told = signing.dumps([_folded(username), number], salt=_SALT)
    answer.set_cookie(
        _cookie(username),
        told,
        max_age=KNOWN_FOR_S,
        path="/api/v1/session",
        secure=settings.SESSION_COOKIE_SECURE,
        httponly=True,
        samesite="Strict",
    )


def _known_browser(request: Request | HttpRequest, username: str) -> str:
    """Return the number of a browser in which this name has signed in; empty: it has not."""
    told = request.COOKIES.get(_cookie(username), "")
    if not told or len(told) > _LONGEST_COOKIE:
        return ""
    try:
        name, number = signing.loads(told, salt=_SALT, max_age=KNOWN_FOR_S)
    except (signing.BadSignature, ValueError, TypeError):
        return ""
    return str(number) if name == _folded(username) else ""


def _cookie(username: str) -> str:
    return _COOKIE + _folded(username)[:16]


def _folded(username: str) -> str:
    return sha256(username.lower().encode(errors="replace")).hexdigest()


def _key(username: str, place: str) -> str:
    return f"signin:{sha256(f'{_folded(username)} {place}'.encode()).hexdigest()}"
