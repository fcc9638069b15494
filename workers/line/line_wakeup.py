"""How a line learns that it has something to do.

A worker that has just acted listens a while for its bell; one that sleeps is sent a message. The
bell costs a fraction of the message, and both may be lost: who hears one looks into the journal,
and the supervisor rings again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from celery import Celery

from workers.base.celery_apps import wake
from workers.base.wake_pipe import WakePipe, ring

log = logging.getLogger(__name__)

LISTENS_S = 2.0


def waker(app: Celery, bell_of: Callable[[str], Path]) -> Callable[[str], None]:
    """Return what wakes a line, by its bell or by message."""

    def wake_line(line: str) -> None:
        if not ring(bell_of(line)):
            wake(app, line)

    return wake_line


def attend(path: Path, drain: Callable[[], object], is_over: Callable[[], bool]) -> None:
    """Drain a line's queue, and then again for each ring, until none has come for a while.

    Whoever found nobody listening has sent a message, which this worker does not take before it
    returns; so it looks once more when it begins to listen, and once when it has ended. Where the
    bell cannot be listened to, messages alone wake the line.

    Args:
        path: Where the line's bell hangs.
        drain: Carries out what may start now.
        is_over: Says whether to listen no longer.
    """
    drain()
    try:
        bell = WakePipe(path)
    except OSError as error:
        log.error("the bell %s cannot be listened to: %s", path.name, error)
        return
    with closing(bell):
        drain()
        while not is_over() and bell.wait(LISTENS_S):
            drain()
    drain()
