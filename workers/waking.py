"""How a line learns that it has something to do.

A worker that has just acted listens a while for a word on the host's Valkey; one that sleeps is
sent a message. The word costs a fraction of the message, and both may be lost: who hears one
looks into the journal, and the supervisor rings again.
"""

from __future__ import annotations

from collections.abc import Callable

from celery import Celery

from workers.app import wake
from workers.store import Store

LISTENS_S = 2.0


def waker(app: Celery, store: Store) -> Callable[[str], None]:
    """Return what wakes a line, by word or by message."""

    def wake_line(line: str) -> None:
        if not store.ring_line(line):
            wake(app, line)

    return wake_line


def attend(
    store: Store, line: str, drain: Callable[[], object], is_over: Callable[[], bool]
) -> None:
    """Drain a line's queue, and then again for each word, until none has come for a while.

    Whoever found nobody listening has sent a message, which this worker does not take before it
    returns; so it looks once more when it begins to listen, and once when it has ended.
    """
    drain()
    with store.listening(line) as wait:
        drain()
        while not is_over() and wait(LISTENS_S):
            drain()
    drain()
