"""Talk to the server as a browser does."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any
from uuid import uuid4

import msgspec
from asgiref.sync import async_to_sync
from django.http import HttpResponse, StreamingHttpResponse
from django.test import Client
from django.urls import URLPattern, URLResolver, get_resolver

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User
from labweb.api.answers.refusals import Refusal
from labweb.api.schema import refusals_of
from labweb.common.answers import answers_of
from labweb.common.database import sessions
from tests.builders import Bench

KEY = "HTTP_IDEMPOTENCY_KEY"
BAD_REQUEST = 400


class Keyed(Client):
    """A client that names each wish with a key of its own, as the page does."""

    def request(self, **request: Any) -> Any:  # noqa: ANN401 - Django's shape
        """Send one request; a key that was given stays, and an empty one is left out."""
        is_api = str(request.get("PATH_INFO", "")).startswith("/api/")
        if is_api and request.get("REQUEST_METHOD") not in {"GET", "HEAD", "OPTIONS"}:
            request.setdefault(KEY, str(uuid4()))
        if not request.get(KEY, "-"):
            del request[KEY]
        answer = super().request(**request)
        if is_api:
            check_answer(str(request.get("REQUEST_METHOD", "GET")), answer)
        return answer


def check_answer(method: str, answer: Any) -> None:  # noqa: ANN401 - Django's shape
    """Fail where an answer is not what its endpoint says in the schema that it is."""
    view = getattr(getattr(answer, "resolver_match", None), "func", None)
    kind = getattr(view, "cls", None)
    is_json = answer.headers.get("Content-Type", "").startswith("application/json")
    if kind is None or not is_json:
        return
    if answer.status_code >= BAD_REQUEST:
        check_refusal(method.lower(), kind, answer)
        return
    if answer.streaming:
        return
    told = answers_of(kind, method.lower())
    asked = dict(answer.wsgi_request.GET.items())
    is_document = any(asked.get(name) == value for name, value in kind.documents.items())
    if not told or getattr(kind, "answer_type", None) or is_document:
        return  # of a format of its own
    if answer.status_code in told and told[answer.status_code] is None:
        assert not answer.content
        return
    shape = told.get(answer.status_code)
    assert shape is not None, f"{method} {kind.__name__} answered {answer.status_code}, not {told}"
    msgspec.json.decode(answer.content, type=shape)


def check_refusal(method: str, kind: Any, answer: Any) -> None:  # noqa: ANN401 - Django's shape
    """Fail where a refusal has a status that the schema does not name, or another shape."""
    if not issubclass(kind, Endpoint) or not hasattr(kind, method):
        return
    assert answer.status_code in refusals_of(kind, method), f"{method} {kind}: {answer.content!r}"
    msgspec.json.decode(answer.content, type=Refusal, strict=True)


def signed_in(user: User | None) -> Client:
    """Return a client with the user's session; None is a stranger."""
    client = Keyed(raise_request_exception=False)
    if user is not None:
        client.force_login(user)
        session = client.session
        sessions.begin(session)
        session.save()
    return client


def call(
    client: Client, method: str, path: str, body: object = None, key: str | None = None
) -> HttpResponse:
    """Send one request with a JSON body; what is streamed is read to its end.

    Without `key` it has one of its own, and none if that is empty.
    """
    data = "" if body is None else json.dumps(body)
    named: dict[str, Any] = {} if key is None else {KEY: key}
    answer = client.generic(method, path, data, content_type="application/json", **named)
    if isinstance(answer, StreamingHttpResponse):
        content = async_to_sync(_whole)(answer)
        return HttpResponse(content, status=answer.status_code, headers=dict(answer.headers))
    assert isinstance(answer, HttpResponse)
    return answer


async def _whole(answer: StreamingHttpResponse) -> bytes:
    return b"".join([block async for block in answer])


def read(client: Client, path: str, status: int = 200) -> dict[str, Any]:
    """Get a JSON answer of the wanted status."""
    answer = call(client, "GET", path)
    assert answer.status_code == status, answer.content[:500]
    found: dict[str, Any] = json.loads(answer.content)
    return found


def code_of(answer: Any) -> str:  # noqa: ANN401 - each test client has its own response
    """Return the stable code of a refusal."""
    return str(json.loads(answer.content)["code"])


def routes(prefix: str = "", under: URLResolver | None = None) -> Iterator[tuple[str, Any]]:
    """List every URL pattern of the server with its view."""
    for entry in (under or get_resolver()).url_patterns:
        route = f"{prefix}{entry.pattern}"
        if isinstance(entry, URLResolver):
            yield from routes(route, entry)
        elif isinstance(entry, URLPattern):
            yield route, entry.callback


def methods_of(view: Any) -> list[str]:  # noqa: ANN401 - a view of any sort
    """List the methods that a view of the REST has; of any other, GET."""
    kind = getattr(view, "view_class", None) or getattr(view, "cls", None)
    names = ("get", "post", "put", "patch", "delete")
    return [name.upper() for name in names if hasattr(kind, name)] or ["GET"]


def weigh(bench: Bench) -> dict[str, Any]:
    """Return a workflow that uses the balance and nothing else."""
    params = {"balance": str(bench.node("balance_1").id)}
    step = {"id": "w", "kind": "weigh", "params": params, "position": {"x": 0, "y": 0}}
    return {"schema": "labweb.workflow/1", "name": "Weigh", "steps": [step], "edges": []}
