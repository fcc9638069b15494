"""Ring the doorbell of an edge host, or of the server's own worker: a message by task name."""

from __future__ import annotations

import logging
from uuid import UUID

import msgspec
from celery.utils import uuid
from kombu.exceptions import OperationalError

from labweb.celery import app
from labweb.domain.messages.devices_and_drivers import Signed

logger = logging.getLogger(__name__)

ACCEPT_TASK = "edge.accept"
SERVER_QUEUE = "server"
"""Of the worker that touches no device."""


def queue_of(host_id: UUID) -> str:
    """Return the name of a host's command queue."""
    return f"edge.{host_id}.cmd"


def connect() -> None:
    """Open the connection to the broker before there is anything to send, if it is there."""
    try:
        with app.producer_or_acquire() as producer:
            broker = producer.connection
            try:
                broker.connect()
            except (*broker.connection_errors, *broker.channel_errors) as error:
                logger.info("the broker is away: %s", error)
    except (OperationalError, OSError) as error:
        logger.info("the broker is away: %s", error)


def ring(host_id: UUID, signed: Signed) -> bool:
    """Send a signed command to a host's queue.

    The queue is the host's own: it alone declares it. A message for a queue that is not
    there yet is lost, and rung again.

    Returns:
        False when the broker is away; the outbox keeps the command and rings again.
    """
    try:
        _post(ACCEPT_TASK, msgspec.to_builtins(signed), queue_of(host_id))
    except (OperationalError, OSError):
        return False
    return True


def _post(task: str, argument: object, queue: str) -> None:
    """Send a task to a queue that nobody declares here; `send_task` takes twice the time."""
    message = app.amqp.as_task_v2(
        uuid(), task, (argument,), {}, argsrepr="", kwargsrepr="", ignore_result=True
    )
    with app.producer_or_acquire() as producer:
        broker = producer.connection
        try:
            producer.publish(
                message.body,
                exchange="",
                routing_key=queue,
                serializer="json",
                headers=message.headers,
                retry=False,
                **message.properties,
            )
        except (*broker.connection_errors, *broker.channel_errors) as error:
            raise OperationalError(str(error)) from error


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
