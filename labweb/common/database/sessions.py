"""Sessions in the database: every request reads one, so with a prepared statement."""

from __future__ import annotations

import time
from typing import Any

from django.conf import settings
from django.contrib.sessions.backends import db
from django.contrib.sessions.backends.base import SessionBase
from django.contrib.sessions.models import Session
from django.db.models import DateTimeField, TextField
from django.utils import timezone

from labweb.common.database.prepared_queries import Given, Prepared

_SESSION = Prepared(
    lambda: Session.objects.filter(
        session_key=Given("key", TextField()), expire_date__gt=Given("now", DateTimeField())
    )
)


_Kept = SessionBase | dict[str, Any]
_ACTED, _CONFIRMED = "acted_at", "confirmed_at"
_NOTED_EVERY_S = 30.0
"""How exactly it is known when a person last did something: each note is a write."""

CONFIRMED_FOR_S = 300.0
"""For how long a password that was typed stands for an act that is signed."""


def begin(session: _Kept) -> None:
    """Note that a person has just signed in with their password."""
    session[_ACTED] = session[_CONFIRMED] = time.time()


def note_act(session: _Kept) -> None:
    """Note that a person does something; a page that asks by itself is none."""
    now_s = time.time()
    if _ACTED in session and now_s - float(session[_ACTED]) > _NOTED_EVERY_S:
        session[_ACTED] = now_s


def confirm(session: _Kept) -> None:
    """Note that the person has just typed their password again."""
    session[_CONFIRMED] = time.time()


def is_confirmed(session: _Kept) -> bool:
    """Tell whether the password was typed so lately that an act may be signed with it."""
    since_s = time.time() - float(session.get(_CONFIRMED, 0.0))
    return 0.0 <= since_s <= CONFIRMED_FOR_S


def is_idle(data: _Kept) -> bool:
    """Tell whether the person has done nothing for so long that they may have left."""
    limit_s = settings.SESSION_IDLE_S
    return bool(limit_s) and _ACTED in data and time.time() - float(data[_ACTED]) > limit_s


class SessionStore(db.SessionStore):
    """Django's, with its own way of reading a session; one that nobody used ends."""

    def load(self) -> dict[str, Any]:
        """Return what the session holds; nothing, and the session is over, after idle time."""
        data: dict[str, Any] = super().load()
        if is_idle(data):
            self.delete(self.session_key)
            self._session_key = None
            return {}
        return data

    def _get_session_from_db(self) -> Session | None:
        row = _SESSION.first(key=self.session_key, now=timezone.now())
        if row is None:
            self._session_key = None
        return row
