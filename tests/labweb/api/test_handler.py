"""A request over ASGI: one thread from the first middleware to the view, streams included."""

from __future__ import annotations

import asyncio
import json
import threading
from dataclasses import replace
from typing import Any

import pytest
from asgiref.sync import async_to_sync, sync_to_async
from asgiref.testing import ApplicationCommunicator
from django.db import connection, connections
from django.http import HttpRequest, HttpResponse, StreamingHttpResponse
from django.test import override_settings
from django.urls import path

from labweb.accounts.models import User
from labweb.api import rate_limits
from labweb.api import request_lanes as handler_module
from labweb.api.request_lanes import Handler
from labweb.common.limits.concurrency import Room
from labweb.common.limits.token_buckets import Rate

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


IN_USE: list[bool] = []
GATE = threading.Event()


def _reads(request: HttpRequest) -> StreamingHttpResponse:
    del request
    User.objects.count()
    thread = threading.get_ident()

    def looks() -> bytes:
        assert threading.get_ident() == thread
        IN_USE.append(connection.connection is not None)
        return b"block "

    async def parts() -> Any:  # noqa: ANN401 - an asynchronous generator
        for _ in range(2):
            yield await sync_to_async(looks)()

    return StreamingHttpResponse(parts())


def _waits(request: HttpRequest) -> HttpResponse:
    del request
    GATE.wait(10)
    return HttpResponse("waited")


urlpatterns = [
    path("answer", _answer),
    path("stream", _stream),
    path("later", _later),
    path("reads", _reads),
    path("api/v1/recipes/open", _waits),
    path("api/v1/lab/stop", _answer),
]


def notes_thread(get_response: Any) -> Any:  # noqa: ANN401 - a middleware
    """Note on which thread it is passed."""

    def pass_on(request: HttpRequest) -> Any:  # noqa: ANN401 - any answer
        SEEN.append(threading.get_ident())
        return get_response(request)

    return pass_on


def _opened(handler: Handler, url: str, address: str, *headers: tuple[bytes, bytes]) -> Any:  # noqa: ANN401 - untyped
    scope = {
        "type": "http",
        "method": "GET",
        "path": url,
        "query_string": b"",
        "headers": [(b"host", b"127.0.0.1"), *headers],
        "client": (address, 0),
    }
    return ApplicationCommunicator(handler, scope)  # type: ignore[no-untyped-call] # untyped


async def _get(
    url: str, handler: Handler | None = None, address: str = "192.0.2.1"
) -> tuple[dict[str, Any], bytes]:
    end = _opened(handler or Handler(), url, address)
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


@pytest.mark.django_db(transaction=True)
def test_no_connection_is_held_while_an_answer_is_sent() -> None:
    IN_USE.clear()
    _, body = async_to_sync(_get)("/reads")
    assert (body, IN_USE) == (b"block block ", [False, False])


async def _all(handler: Handler, url: str, addresses: list[str]) -> list[tuple[int, Any, str]]:
    async def one(address: str) -> tuple[int, Any, str]:
        start, body = await _get(url, handler, address)
        headers = dict(start["headers"])
        again = headers.get(b"Retry-After", b"").decode()
        return start["status"], json.loads(body) if again else body, again

    asked = [asyncio.create_task(one(address)) for address in addresses]
    await asyncio.sleep(0.3)
    began = asyncio.get_running_loop().time()
    start, _ = await _get("/api/v1/lab/stop", handler, "192.0.2.99")
    assert (start["status"], asyncio.get_running_loop().time() - began < 1.0) == (200, True)
    GATE.set()
    return list(await asyncio.gather(*asked))


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> Handler:
    GATE.clear()
    slow = replace(rate_limits.TERMS[rate_limits.Pace.SLOW], waits_s=0.2, own_waiting_count=1)
    monkeypatch.setitem(rate_limits.TERMS, rate_limits.Pace.SLOW, slow)
    return Handler()


def test_of_what_is_slow_one_caller_has_a_share_and_is_told_when_to_come_again(
    impatient: Handler,
) -> None:
    answers = async_to_sync(_all)(impatient, "/api/v1/recipes/open", ["192.0.2.1"] * 8)
    assert sorted(status for status, _, _ in answers) == [200] * 2 + [429] * 6
    refused = [(body["code"], body["effect"], again) for _, body, again in answers if again]
    assert refused == [("http.too_many", "none", "2")] * 6


def test_of_what_is_slow_there_is_so_much_in_all_and_the_rest_is_told_so(
    impatient: Handler,
) -> None:
    addresses = [f"192.0.2.{number}" for number in range(1, 9)]
    answers = async_to_sync(_all)(impatient, "/api/v1/recipes/open", addresses)
    assert sorted(status for status, _, _ in answers) == [200] * 3 + [503] * 5
    assert {body["code"] for _, body, again in answers if again} == {"http.busy"}


def test_answers_that_are_sent_are_bounded_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handler_module, "STREAMS", Room(most=1, most_of_one=1))
    handler = Handler()

    async def two() -> list[int]:
        first = _opened(handler, "/stream", "192.0.2.1")
        await handler._streams.enter("address:192.0.2.1")
        await first.send_input({"type": "http.request", "body": b""})
        refused = await first.receive_output(10.0)
        await first.receive_output(10.0)
        await first.wait(10.0)
        handler._streams.leave("address:192.0.2.1")
        start, _ = await _get("/stream", handler)
        return [refused["status"], start["status"]]

    assert async_to_sync(two)() == [429, 200]


def test_who_asks_too_often_is_told_how_long_to_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = replace(rate_limits.TERMS[rate_limits.Pace.QUICK], rate=Rate(per_s=0.5, burst_count=2))
    monkeypatch.setitem(rate_limits.TERMS, rate_limits.Pace.QUICK, quick)
    handler = Handler()

    async def five() -> list[tuple[int, bytes]]:
        answers = [await _get("/answer", handler) for _ in range(4)]
        answers.append(await _get("/answer", handler, "192.0.2.2"))
        return [
            (start["status"], dict(start["headers"]).get(b"Retry-After", b""))
            for start, _ in answers
        ]

    assert async_to_sync(five)() == [(200, b""), (200, b""), (429, b"2"), (429, b"2"), (200, b"")]


@pytest.mark.parametrize("declared", [True, False])
def test_a_body_that_is_too_large_is_refused_before_it_is_kept(declared: bool) -> None:
    size = rate_limits.MOST_BODY_BYTES + 1
    headers = [(b"content-length", str(size).encode())] if declared else []

    async def send() -> tuple[int, Any]:
        end = _opened(Handler(), "/answer", "192.0.2.1", *headers)
        part = b"" if declared else b"x" * (size // 2 + 1)
        for _ in range(2):
            await end.send_input({"type": "http.request", "body": part, "more_body": True})
        start = await end.receive_output(10.0)
        body = await end.receive_output(10.0)
        await end.wait(10.0)
        assert dict(start["headers"])[b"Connection"] == b"close"
        return start["status"], json.loads(body["body"])["code"]

    assert async_to_sync(send)() == (413, "http.too_large")


def test_a_body_that_does_not_come_is_given_up(settings: Any) -> None:  # noqa: ANN401
    settings.RECEIVE_WITHIN_S = 0.05

    async def send() -> tuple[int, Any]:
        end = _opened(Handler(), "/answer", "192.0.2.1")
        await end.send_input({"type": "http.request", "body": b"x", "more_body": True})
        start = await end.receive_output(10.0)
        body = await end.receive_output(10.0)
        await end.wait(10.0)
        return start["status"], json.loads(body["body"])["code"]

    assert async_to_sync(send)() == (408, "http.too_slow")
