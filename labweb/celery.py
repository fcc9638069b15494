"""The server's Celery app: it sends to hosts, and runs the server's own jobs."""

from __future__ import annotations

import os

from celery import Celery
from django.conf import settings

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "labweb.settings.local")

app = Celery("labweb", broker=settings.BROKER_URL, set_as_current=True)
app.conf.update(
    task_serializer="json",
    accept_content=["json"],
    result_backend=None,
    task_ignore_result=True,
    task_default_queue="server",
    broker_connection_retry_on_startup=True,
    broker_connection_max_retries=None,
    broker_transport_options=(
        {"confirm_publish": True} if settings.BROKER_URL.startswith("amqp") else {}
    ),
    worker_enable_remote_control=False,
    worker_send_task_events=False,
    worker_cancel_long_running_tasks_on_connection_loss=False,
    worker_prefetch_multiplier=1,
)
app.autodiscover_tasks(["labweb.runs"])
