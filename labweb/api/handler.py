"""How a request goes from the event loop to Django."""

from __future__ import annotations

from typing import Any

from asgiref.sync import sync_to_async
from django.core.handlers.asgi import ASGIHandler


class Handler(ASGIHandler):
    """Django's handler with middleware and view on one thread, from the first to the last.

    Django's own takes each part of the middleware to the thread and back by itself; all of ours
    is synchronous but for answers that stream, which the event loop sends in either case.
    """

    def load_middleware(self, is_async: bool = False) -> None:  # noqa: FBT001, FBT002 - Django's shape
        """Build the chain as for WSGI, and go over to its thread once."""
        del is_async
        super().load_middleware(is_async=False)
        chain: Any = self._middleware_chain
        self._middleware_chain: Any = sync_to_async(chain, thread_sensitive=True)
