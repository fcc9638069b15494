"""Two Celery apps: one on the server's broker that takes work in, one on the host's own that acts.

The message that wakes a line names the line and nothing else; the signed row in the journal
is the authority. A message that is lost is posted again; one that comes twice finds nothing
to do. So `edge.accept` acknowledges late, being short and idempotent, and `edge.execute`
early: with a late acknowledgement one broken connection makes a device act twice.

Source:
    Celery 5 user guide, "Configuration and defaults", `task_acks_late`,
    `worker_cancel_long_running_tasks_on_connection_loss`.
"""

from __future__ import annotations

import logging
from typing import Any
from urllib.parse import urlsplit

from celery import Celery
from celery.utils import uuid
from kombu import Queue
from kombu.exceptions import OperationalError

from workers.base.config import HostConfig, command_queue, line_queue

log = logging.getLogger(__name__)

ACCEPT = "edge.accept"
EXECUTE = "edge.execute"

REDIS_OPTIONS: dict[str, Any] = {
    "visibility_timeout": 45,
    "unacked_restore_interval": 5,
    "unacked_restore_throttle": 1,
    "socket_timeout": 30,
    "socket_connect_timeout": 5,
    "socket_keepalive": True,
}
AMQP_OPTIONS: dict[str, Any] = {"confirm_publish": True}

DELIVERY_LIMIT = 20
"""A quorum queue drops a message that came back this often; the dead-letter exchange keeps it."""

WORKER_OPTIONS = (
    "--pool=solo",
    "--concurrency=1",
    "--without-gossip",
    "--without-mingle",
    "--without-heartbeat",
)

PINNED: dict[str, Any] = {
    "task_serializer": "json",
    "result_serializer": "json",
    "accept_content": ["json"],
    "result_backend": None,
    "task_ignore_result": True,
    "task_store_errors_even_if_ignored": False,
    "task_create_missing_queues": False,
    "task_time_limit": None,
    "task_soft_time_limit": None,
    "task_send_sent_event": False,
    "worker_send_task_events": False,
    "worker_prefetch_multiplier": 1,
    "worker_max_tasks_per_child": None,
    "worker_max_memory_per_child": None,
    "worker_cancel_long_running_tasks_on_connection_loss": False,
    "worker_enable_prefetch_count_reduction": False,
    "worker_enable_remote_control": False,
    "worker_hijack_root_logger": False,
    "worker_redirect_stdouts": False,
    "broker_connection_retry_on_startup": True,
    "broker_connection_max_retries": None,
    "broker_pool_limit": 2,
    "enable_utc": True,
}


def transport_options(broker_url: str) -> dict[str, Any]:
    """Return the options that fit the broker's kind."""
    scheme = urlsplit(broker_url).scheme
    return dict(AMQP_OPTIONS if scheme.startswith(("amqp", "pyamqp")) else REDIS_OPTIONS)


def make_accept_app(config: HostConfig) -> Celery:
    """Make the app that consumes the host's queue on the server's broker, and no other."""
    app = Celery(
        "workers.accept",
        broker=config.broker_url,
        set_as_current=False,
        fixups=[],
    )
    app.conf.update(PINNED)
    app.conf.update(
        task_acks_late=False,
        broker_transport_options=transport_options(config.broker_url),
        task_queues=[_command_queue(config)],
        task_default_queue=command_queue(config.host_id),
    )
    return app


def make_host_app(config: HostConfig, lines: tuple[str, ...] = ()) -> Celery:
    """Make the app on the host's own broker; a worker consumes the queue of one line."""
    app = Celery(
        "workers.execute",
        broker=config.host_broker_url,
        set_as_current=False,
        fixups=[],
    )
    app.conf.update(PINNED)
    app.conf.update(
        task_acks_late=False,
        broker_transport_options=transport_options(config.host_broker_url),
        task_queues=[Queue(line_queue(line), routing_key=line_queue(line)) for line in lines],
        task_create_missing_queues=not lines,
    )
    return app


def wake(app: Celery, line: str) -> None:
    """Ring a line's bell. Losing it does no harm: the supervisor rings again."""
    try:
        post(app, EXECUTE, [line], line_queue(line))
    except OperationalError as error:
        log.warning("line %s could not be woken: %s", line, error)


def post(app: Celery, task: str, args: list[Any], queue: str) -> None:
    """Send a task to a queue that is there already, as `Celery.send_task` does in twice the time.

    Raises:
        kombu.exceptions.OperationalError: The broker is away.
    """
    message = app.amqp.as_task_v2(
        uuid(), task, tuple(args), {}, argsrepr="", kwargsrepr="", ignore_result=True
    )
    with app.producer_or_acquire() as producer:
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
        except (
            *producer.connection.connection_errors,
            *producer.connection.channel_errors,
        ) as error:
            raise OperationalError(str(error)) from error


def _command_queue(config: HostConfig) -> Queue:
    name = command_queue(config.host_id)
    arguments: dict[str, Any] | None = None
    if urlsplit(config.broker_url).scheme.startswith(("amqp", "pyamqp")):
        arguments = {
            "x-queue-type": "quorum",
            "x-delivery-limit": DELIVERY_LIMIT,
            "x-dead-letter-exchange": "edge.dead",
            "x-single-active-consumer": True,
        }
    return Queue(name, routing_key=name, durable=True, queue_arguments=arguments)
