"""What the fork server imports before it forks: the code that all of a host's processes share."""

from __future__ import annotations

IMPORTS = (
    "billiard.pool",
    "workers.host.process_main",
    "workers.tryouts.driver_trial",
    "celery.app.amqp",
    "celery.app.control",
    "celery.app.events",
    "celery.app.log",
    "celery.apps.worker",
    "celery.backends.base",
    "celery.bin.celery",
    "celery.concurrency.solo",
    "celery.events.receiver",
    "celery.loaders.app",
    "celery.worker.autoscale",
    "celery.worker.components",
    "celery.worker.consumer.delayed_delivery",
    "celery.worker.strategy",
    "celery.worker.worker",
    "kombu.transport.redis",
)
"""What takes long, or is imported late; none of it may start a thread."""
