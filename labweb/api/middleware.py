"""Security headers on every answer, and one effect of each form of the admin pages."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Awaitable, Callable
from inspect import iscoroutinefunction

from django.db.transaction import set_rollback
from django.http import HttpRequest, HttpResponse
from django.http.response import HttpResponseBase
from django.utils.decorators import sync_and_async_middleware

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common.database import sessions

_APP_POLICY = (
    "default-src 'self'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'self'"
)
"""Inline styles stay allowed: the component library and React Flow place things with them."""

_KEPT_HEADERS = ("Content-Type", "Location", "Cache-Control")
_FAILED = 500

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


def once_per_form(get_response: Callable[[HttpRequest], HttpResponse]) -> Handler:
    """Let one form of the admin pages act once, however often it is sent.

    Each form carries a token against forgery that is masked anew each time that it is shown, so
    that the token names the wish. What is kept as one fills in (`keep`) may be sent again.
    """

    def answer(request: HttpRequest) -> HttpResponse:
        user = request.user
        if request.method != "POST" or not request.path.startswith("/admin/"):
            return get_response(request)
        token = request.POST.get("csrfmiddlewaretoken")
        if not token or not isinstance(user, User) or request.POST.get("act") == "keep":
            return get_response(request)
        digest = _digest_of_form(request)

        def act() -> account_services.WishAnswer:
            response = get_response(request)
            if response.status_code >= _FAILED:
                set_rollback(True)
            first.append(response)
            headers = {name: response[name] for name in _KEPT_HEADERS if name in response}
            return account_services.WishAnswer(response.status_code, response.content, headers)

        first: list[HttpResponse] = []
        try:
            found = account_services.carry_out_once(
                act, actor=user, key=f"{token} {digest}", digest=digest
            )
        except account_services.KeyInUseError:
            return HttpResponse("The first of these is being carried out.", status=409)
        return (
            first[0]
            if first
            else HttpResponse(found.content, None, found.status, headers=found.headers)
        )

    return answer


def _digest_of_form(request: HttpRequest) -> str:
    files = [
        [name, hashlib.sha256(file.read()).hexdigest(), file.seek(0)]
        for name, brought in request.FILES.lists()
        for file in brought
    ]
    told = [request.get_full_path(), sorted(map(list, request.POST.lists())), files]
    return hashlib.sha256(json.dumps(told).encode()).hexdigest()
