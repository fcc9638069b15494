"""Start and end of the web process."""

from __future__ import annotations

import logging
import threading
from collections.abc import Awaitable, Callable
from importlib import import_module
from typing import Any

from celery import Celery
from django.conf import settings
from django.db import OperationalError, connection

from labweb.common.garbage_collection import freeze_heap
from labweb.runs.api.run_details import render_run
from labweb.runs.services import rehearse_start

logger = logging.getLogger(__name__)

Application = Callable[[Any, Any, Any], Awaitable[None]]


_CONNECTIONS = 2
"""To the database that a lab with one page open needs at a time."""


def _rehearse() -> None:
    """Go the way of a click once on each connection, while the first pages are asked for."""
    gate = threading.Barrier(_CONNECTIONS)
    for _ in range(_CONNECTIONS):
        threading.Thread(target=_rehearse_once, args=(gate,), name="rehearsal", daemon=True).start()


def _rehearse_once(gate: threading.Barrier) -> None:
    try:
        connection.ensure_connection()
        gate.wait(_GATE_S)
        rehearse_start(lambda run: render_run(run, run.created_by))
    except (OperationalError, threading.BrokenBarrierError) as error:
        logger.info("nothing is rehearsed: %s", error)
    finally:
        connection.close()


_GATE_S = 10.0


def with_lifespan(inner: Application, queue: Celery) -> Application:
    """Answer the server's lifespan messages; everything else goes inside."""

    async def application(scope: Any, receive: Any, send: Any) -> None:  # noqa: ANN401 - ASGI
        if scope["type"] != "lifespan":
            await inner(scope, receive, send)
            return
        while True:
            message = await receive()
            if message["type"] == "lifespan.startup":
                import_module(settings.ROOT_URLCONF)  # or the first request would load every view
                freeze_heap()
                _rehearse()
                logger.info("web is up; commands go to %s", queue.connection().as_uri())
                await send({"type": "lifespan.startup.complete"})
            elif message["type"] == "lifespan.shutdown":
                await send({"type": "lifespan.shutdown.complete"})
                return

    return application
