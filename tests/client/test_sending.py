"""A call is sent until it is answered, each time with the same key, and has one effect."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any

import pytest

from labweb_client import CallRefusedError, CallUnansweredError, LabClient
from labweb_client.generated import models
from labweb_client.sending import wait_s

Reply = tuple[int, Any, dict[str, str]]
DROPPED: Reply = (0, None, {})
"""The connection ends without an answer."""


@contextmanager
def serving(replies: list[Reply]) -> Iterator[tuple[str, list[tuple[str, str, str]]]]:
    """Serve these answers one after another; note method, address and key of each request."""
    heard: list[tuple[str, str, str]] = []

    class Handler(BaseHTTPRequestHandler):
        def _answer(self) -> None:
            length = int(self.headers.get("Content-Length", 0))
            self.rfile.read(length)
            heard.append((self.command, self.path, self.headers.get("Idempotency-Key", "")))
            status, body, headers = replies.pop(0)
            if not status:
                self.close_connection = True
                return
            content = json.dumps(body).encode()
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        do_GET = do_POST = do_DELETE = _answer  # noqa: N815 - the library's names

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", heard
    finally:
        server.shutdown()
        server.server_close()


REFUSED = {"code": "token.scope", "message": "no", "effect": "none", "context": {}, "findings": []}
PAGE: dict[str, Any] = {"tokens": [], "next": None}


def test_what_is_not_answered_is_sent_again_with_the_same_key() -> None:
    with (
        serving([DROPPED, (503, REFUSED, {"Retry-After": "0"}), (204, None, {})]) as (url, heard),
        LabClient(url, "labweb_x") as lab,
    ):
        lab.delete_token("t1")
    assert [method for method, _, _ in heard] == ["DELETE"] * 3
    assert len({key for _, _, key in heard}) == 1
    assert heard[0][2]


def test_two_wishes_have_two_keys_and_a_given_key_is_kept() -> None:
    with serving([(204, None, {})] * 3) as (url, heard), LabClient(url, "labweb_x") as lab:
        lab.delete_token("t1")
        lab.delete_token("t1")
        lab.delete_token("t1", key="my-own-key")
    keys = [key for _, _, key in heard]
    assert len(set(keys)) == 3
    assert keys[2] == "my-own-key"


def test_a_refusal_is_the_last_word() -> None:
    with (
        serving([(403, REFUSED, {})]) as (url, heard),
        LabClient(url, "labweb_x") as lab,
        pytest.raises(CallRefusedError) as refused,
    ):
        lab.post_workflows(models.NewWorkflow(name="x"))
    assert (refused.value.status, refused.value.code) == (403, "token.scope")
    assert len(heard) == 1


def test_who_never_answers_is_given_up() -> None:
    with (
        serving([DROPPED] * 2) as (url, heard),
        LabClient(url, "labweb_x", attempts_count=2) as lab,
        pytest.raises(CallUnansweredError),
    ):
        lab.delete_token("t1")
    assert len(heard) == 2


def test_a_list_is_read_to_its_end() -> None:
    more: dict[str, Any] = {"tokens": [], "next": "cursor 2"}
    with serving([(200, more, {}), (200, PAGE, {})]) as (url, heard), LabClient(url, "x") as lab:
        assert len(list(lab.pages(lab.get_tokens, of="all"))) == 2
    assert [path for _, path, _ in heard] == [
        "/api/v1/tokens?of=all",
        "/api/v1/tokens?after=cursor+2&of=all",
    ]


@pytest.mark.parametrize(
    ("status", "content", "is_sent_again"),
    [
        (200, b"", False),
        (404, b"", False),
        (409, b'{"code": "http.in_progress", "message": ""}', True),
        (409, b'{"code": "crutd.revision", "message": ""}', False),
        (422, b"", False),
        (429, b"", True),
        (500, b"", True),
        (503, b"", True),
        (0, b"", True),
    ],
)
def test_which_answers_are_not_final(status: int, content: bytes, *, is_sent_again: bool) -> None:
    assert (wait_s(1, status, None, content) is not None) == is_sent_again


def test_the_server_says_how_long_to_wait() -> None:
    assert wait_s(1, 429, "7", b"") == 7
    assert wait_s(1, 429, "3600", b"") == 30
    assert wait_s(1, 429, "soon", b"") == 0.25
    waits = [wait_s(attempt, 0, None, b"") for attempt in (1, 2, 3)]
    assert waits == [0.25, 0.5, 1.0]


@pytest.mark.parametrize("url", ["", "lab.example.org", "ftp://lab", "http://lab.example.org"])
def test_an_address_that_gives_the_token_away_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match=r"address|unencrypted"):
        LabClient(url, "labweb_x")
    LabClient("http://lab.example.org", "labweb_x", is_plain_allowed=True)


def test_what_may_have_been_carried_out_is_sent_again_with_its_key() -> None:
    busy: Reply = (409, {"code": "http.in_progress", "message": ""}, {})
    with (
        serving([busy] * 2) as (url, heard),
        LabClient(url, "labweb_x", attempts_count=2) as lab,
        pytest.raises(CallUnansweredError) as unanswered,
    ):
        lab.delete_token("t1")
    assert unanswered.value.key == heard[0][2]
    with (
        serving([DROPPED, (503, REFUSED, {})]) as (url, _),
        LabClient(url, "labweb_x", attempts_count=2) as lab,
        pytest.raises(CallUnansweredError),
    ):
        lab.delete_token("t1")
    with (
        serving([(503, REFUSED, {})] * 2) as (url, _),
        LabClient(url, "labweb_x", attempts_count=2) as lab,
        pytest.raises(CallRefusedError),
    ):
        lab.delete_token("t1")
