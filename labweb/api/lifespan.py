"""Start and end of the web process."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from importlib import import_module
from typing import Any

from celery import Celery
from django.conf import settings

from labweb.common.heap import freeze_heap

logger = logging.getLogger(__name__)

Application = Callable[[Any, Any, Any], Awaitable[None]]


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
                logger.info("web is up; commands go to %s", queue.connection().as_uri())
                await send({"type": "lifespan.startup.complete"})
            elif message["type"] == "lifespan.shutdown":
                await send({"type": "lifespan.shutdown.complete"})
                return

    return application
