"""Security headers on every answer."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from inspect import iscoroutinefunction

from django.http import HttpRequest
from django.http.response import HttpResponseBase
from django.utils.decorators import sync_and_async_middleware

from labweb.common import sessions

_APP_POLICY = (
    "default-src 'self'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'self'"
)
"""Inline styles stay allowed: the component library and React Flow place things with them."""

Handler = (
    Callable[[HttpRequest], HttpResponseBase] | Callable[[HttpRequest], Awaitable[HttpResponseBase]]
)


@sync_and_async_middleware
def headers(get_response: Handler) -> Handler:
    """Add the content security policy unless a view has set its own."""
    if iscoroutinefunction(get_response):

        async def answer_async(request: HttpRequest) -> HttpResponseBase:
            return _with_policy(await get_response(request))

        return answer_async

    def answer(request: HttpRequest) -> HttpResponseBase:
        response = get_response(request)
        assert isinstance(response, HttpResponseBase)  # noqa: S101 - narrows the sync branch
        return _with_policy(response)

    return answer


def acts(get_response: Callable[[HttpRequest], HttpResponseBase]) -> Handler:
    """Note each request that a person makes: what acts, and every page of the admin."""

    def answer(request: HttpRequest) -> HttpResponseBase:
        is_read = request.method in {"GET", "HEAD", "OPTIONS"}
        if not is_read or request.path.startswith("/admin/"):
            sessions.note_act(request.session)
        return get_response(request)

    return answer


def _with_policy(response: HttpResponseBase) -> HttpResponseBase:
    response.headers.setdefault("Content-Security-Policy", _APP_POLICY)
    response.headers.setdefault("Permissions-Policy", "camera=(), microphone=(), geolocation=()")
    return response
