"""A doorbell for the dispatcher: PostgreSQL's NOTIFY, rung when the transaction commits.

It carries nothing and may be lost, with the connection or before anybody listens: the
dispatcher also looks without it, a tick later. The database stays the queue.

Source:
    PostgreSQL documentation, "NOTIFY": delivered at commit, equal ones of a transaction once.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from typing import Any

import psycopg
from django.db import connection

from labweb.common.database.prepared_queries import Question, together

logger = logging.getLogger(__name__)

CHANNEL = "labweb_work"


def wake_dispatcher() -> None:
    """Say that there will be work once this transaction has committed."""
    together(waking())


def waking() -> Question[Any]:
    """Return what says so, to be asked with others."""
    return Question(f"NOTIFY {CHANNEL}", [], tuple)


class Listener:
    """The dispatcher's ear, on a connection of its own that is opened when it is needed."""

    def __init__(self) -> None:
        self._connection: psycopg.Connection[Any] | None = None

    def wait(self, longest_s: float) -> bool:
        """Wait for the bell, or for so long; a database that is away counts as silence.

        Returns:
            True when it rang, or may have rung while nobody listened.
        """
        try:
            if self._connection is None:
                self._connection = _listen()
                return True
            return bool(list(self._connection.notifies(timeout=longest_s, stop_after=1)))
        except psycopg.Error as error:
            logger.warning("the dispatcher hears no bell: %s", error)
            self.close()
            threading.Event().wait(longest_s)
            return False

    def close(self) -> None:
        """Listen no more."""
        if self._connection is not None:
            with contextlib.suppress(psycopg.Error):
                self._connection.close()
            self._connection = None


def _listen() -> psycopg.Connection[Any]:
    made: psycopg.Connection[Any] = psycopg.connect(
        **connection.get_connection_params(), autocommit=True
    )
    made.execute(f"LISTEN {CHANNEL}")
    return made
