"""Websocket routes. Edge hosts carry a key and no cookie; browsers the reverse."""

from __future__ import annotations

from typing import Any

from channels.routing import ProtocolTypeRouter, URLRouter
from channels.sessions import SessionMiddlewareStack
from django.urls import re_path

from labweb.api.live import BrowserConsumer, NoSuchConsumer
from labweb.api.request_lanes import Handler
from labweb.api.twin.feed import FeedConsumer
from labweb.api.twin.proxy import TwinConsumer
from labweb.fleet.live import EdgeConsumer


def _route(pattern: str, consumer: Any) -> Any:  # noqa: ANN401 - Django's types know no ASGI
    return re_path(pattern, consumer)


routes: list[Any] = [
    _route(r"^ws/edge/v1/$", EdgeConsumer.as_asgi()),
    _route(r"^ws/v1/$", SessionMiddlewareStack(BrowserConsumer.as_asgi())),
    _route(r"^ws/v1/feed$", FeedConsumer.as_asgi()),
    _route(
        r"^twin/view(?:/(?P<theme>light|dark))?/?$", SessionMiddlewareStack(TwinConsumer.as_asgi())
    ),
    _route(r"", NoSuchConsumer.as_asgi()),
]


def application() -> ProtocolTypeRouter:
    """Build the ASGI application of HTTP and websockets."""
    return ProtocolTypeRouter({"http": Handler(), "websocket": URLRouter(routes)})
