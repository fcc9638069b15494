"""Ring the doorbell of an edge host, or of the server's own worker: a message by task name."""

from __future__ import annotations

from uuid import UUID

import msgspec
from kombu import Queue
from kombu.exceptions import OperationalError

from labweb.celery import app
from labweb.domain.messages import Signed

ACCEPT_TASK = "edge.accept"
SERVER_QUEUE = "server"
"""Of the worker that touches no device."""


def queue_of(host_id: UUID) -> str:
    """Return the name of a host's command queue."""
    return f"edge.{host_id}.cmd"


def ring(host_id: UUID, signed: Signed) -> bool:
    """Send a signed command to a host's queue.

    The queue is the host's own: it alone declares it. A message for a queue that is not
    there yet is lost, and rung again.

    Returns:
        False when the broker is away; the outbox keeps the command and rings again.
    """
    try:
        app.send_task(
            ACCEPT_TASK,
            args=[msgspec.to_builtins(signed)],
            queue=Queue(queue_of(host_id), no_declare=True),  # type: ignore[arg-type]
            declare=[],
            ignore_result=True,
            retry=False,
        )
    except (OperationalError, OSError):
        return False
    return True


def ask(task: str, *args: str) -> bool:
    """Ask the server's own worker for a task.

    Returns:
        False when the broker is away. What is to be done stands in the database, where the
        dispatcher finds it again.
    """
    try:
        app.send_task(task, args=args, queue=SERVER_QUEUE, ignore_result=True, retry=False)
    except (OperationalError, OSError):
        return False
    return True
