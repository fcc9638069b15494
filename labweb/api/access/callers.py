"""Under which name a request is counted: the user of its session, or the address."""

from __future__ import annotations

import time
from collections import OrderedDict
from hashlib import sha256

from django.conf import settings
from django.contrib.auth import SESSION_KEY
from django.http import HttpRequest
from django.utils.module_loading import import_string

from labweb.api.access.token_sign_in import caller_of, token_of
from labweb.api.outermost_layer import name_of

REMEMBER_S = 60.0
MOST_SESSIONS = 10_000


class Callers:
    """Whose sessions were seen lately. It decides nobody's rights, only whose count grows."""

    def __init__(self) -> None:
        self._known: OrderedDict[bytes, tuple[str, float]] = OrderedDict()

    def find(self, session_key: str) -> str | None:
        """Return the name; empty when it is nobody's session, None when it is not known."""
        found = self._known.get(_digest(session_key))
        if found is None or found[1] < time.monotonic():
            return None
        return found[0]

    def keep(self, session_key: str, name: str) -> None:
        """Remember it for a while."""
        self._known[_digest(session_key)] = (name, time.monotonic() + REMEMBER_S)
        self._known.move_to_end(_digest(session_key))
        if len(self._known) > MOST_SESSIONS:
            self._known.popitem(last=False)


def caller_of_token(secret: str) -> str:
    """Return under which name an access token is counted; empty: it is none that is valid."""
    token = token_of(secret)
    return "" if token is None else caller_of(token)


def stranger_of(request: HttpRequest) -> str:
    """Return the name of the address that a request comes from."""
    return name_of(str(request.META.get("REMOTE_ADDR", "")))


def caller_of_session(session_key: str) -> str:
    """Return the name of the user of a session; empty: it is nobody's."""
    store = import_string(f"{settings.SESSION_ENGINE}.SessionStore")(session_key)
    user = store.get(SESSION_KEY)
    return f"user:{user}" if user else ""


def _digest(session_key: str) -> bytes:
    return sha256(session_key.encode(errors="replace")).digest()
