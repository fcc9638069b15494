"""A request over ASGI: one thread from the first middleware to the view, streams included."""

from __future__ import annotations

import threading
from typing import Any

import pytest
from asgiref.sync import async_to_sync
from asgiref.testing import ApplicationCommunicator
from django.db import connections
from django.http import HttpRequest, HttpResponse, StreamingHttpResponse
from django.test import override_settings
from django.urls import path

from labweb.api.handler import Handler

SEEN: list[int] = []


def _answer(request: HttpRequest) -> HttpResponse:
    del request
    SEEN.append(threading.get_ident())
    return HttpResponse("here")


def _stream(request: HttpRequest) -> StreamingHttpResponse:
    del request

    async def parts() -> Any:  # noqa: ANN401 - an asynchronous generator
        for number in range(3):
            yield f"{number} "

    return StreamingHttpResponse(parts())


async def _later(request: HttpRequest) -> HttpResponse:
    del request
    return HttpResponse("later")


urlpatterns = [path("answer", _answer), path("stream", _stream), path("later", _later)]


def notes_thread(get_response: Any) -> Any:  # noqa: ANN401 - a middleware
    """Note on which thread it is passed."""

    def pass_on(request: HttpRequest) -> Any:  # noqa: ANN401 - any answer
        SEEN.append(threading.get_ident())
        return get_response(request)

    return pass_on


async def _get(url: str) -> tuple[dict[str, Any], bytes]:
    scope = {
        "type": "http",
        "method": "GET",
        "path": url,
        "query_string": b"",
        "headers": [(b"host", b"127.0.0.1")],
    }
    end: Any = ApplicationCommunicator(Handler(), scope)  # type: ignore[no-untyped-call] # untyped
    await end.send_input({"type": "http.request", "body": b""})
    start = await end.receive_output(10.0)
    body = b""
    while (part := await end.receive_output(10.0)).get("more_body"):
        body += part.get("body", b"")
    await end.wait(10.0)
    return start, body + part.get("body", b"")


@pytest.fixture(autouse=True)
def _here(settings: Any) -> Any:  # noqa: ANN401 - the settings of the test
    own = [f"{__name__}.notes_thread"]
    settings.ALLOWED_HOSTS = ["127.0.0.1"]
    with override_settings(ROOT_URLCONF=__name__, MIDDLEWARE=own + settings.MIDDLEWARE + own):
        yield
    connections.close_all()


def test_middleware_and_view_run_on_one_thread_that_is_not_the_loops() -> None:
    SEEN.clear()
    start, body = async_to_sync(_get)("/answer")
    assert (start["status"], body) == (200, b"here")
    assert len(SEEN) == 3
    assert len(set(SEEN)) == 1
    assert SEEN[0] != threading.get_ident()
    names = {name for name, _ in start["headers"]}
    assert b"Content-Security-Policy" in names


@pytest.mark.parametrize(("url", "wanted"), [("/stream", b"0 1 2 "), ("/later", b"later")])
def test_answers_that_stream_or_come_later_are_whole(url: str, wanted: bytes) -> None:
    start, body = async_to_sync(_get)(url)
    assert (start["status"], body) == (200, wanted)
