"""Lots are fetched from another system, all of them or none."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, HTTPServer
from io import StringIO
from pathlib import Path

import pytest
from django.core.management import CommandError, call_command

from tests.builders import Bench
from tests.labweb.crutd.hand import held, rows

ROW = {
    "lot": "w7", "material": "water", "phase": "liquid", "vessel": "flask_1", "amount": "2 mL",
}  # fmt: skip


@dataclass
class Lims:
    """Another system, on a port of its own."""

    url: str = ""
    status: int = 200
    body: bytes = b""
    tokens: list[str | None] = field(default_factory=list)


@pytest.fixture
def lims() -> Iterator[Lims]:
    told = Lims()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            told.tokens.append(self.headers["Authorization"])
            self.send_response(told.status)
            self.send_header("Content-Length", str(len(told.body)))
            self.end_headers()
            self.wfile.write(told.body)

        def log_message(self, *args: object) -> None:
            """Keep quiet."""

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        told.url = f"http://127.0.0.1:{server.server_port}/lots"
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield told
        server.shutdown()
        thread.join()


def pull(lims: Lims, *words: str) -> str:
    out = StringIO()
    call_command("pull_lots", lims.url, *words, by="chemist", stdout=out, stderr=StringIO())
    return out.getvalue()


def test_lots_of_another_system_are_received_once(bench: Bench, lims: Lims, tmp_path: Path) -> None:
    lims.body = json.dumps({"lots": [ROW], "page": 1}).encode()
    token = tmp_path / "token"
    token.write_text("abc\n")
    before = rows()
    assert json.loads(pull(lims, "--check")) == {"verdict": "checked", "lots": ["w7"]}
    assert rows() == before
    assert json.loads(pull(lims, "--token-file", str(token)))["verdict"] == "received"
    assert held(bench, "flask_1") == {"w7": (2_000_000, 0)}
    assert lims.tokens == [None, "Bearer abc"]
    with pytest.raises(CommandError, match="received already"):
        pull(lims)


@pytest.mark.parametrize(
    ("status", "body", "words"),
    [
        (500, b"", "the answer is 500"),
        (302, b"", "the answer is 302"),
        (200, b"<html>", r"lims\.answer"),
        (200, b'{"lots": [{"lot": 1}]}', r"lims\.answer"),
        (200, b'{"lots": [{"lot": "w"}]}', r"lots\.invalid"),
        (200, b" " * (8 * 2**20 + 1), r"lims\.answer"),
    ],
)
def test_an_answer_that_is_wrong_changes_nothing(
    bench: Bench, lims: Lims, status: int, body: bytes, words: str
) -> None:
    lims.status, lims.body = status, body
    before = rows()
    with pytest.raises(CommandError, match=words):
        pull(lims)
    assert rows() == before


def test_a_system_elsewhere_is_asked_by_https_alone(bench: Bench) -> None:
    with pytest.raises(CommandError, match=r"lims\.address"):
        pull(Lims(url="http://lims.example.org/lots"))


def test_a_system_that_is_not_there_is_told(bench: Bench, lims: Lims) -> None:
    with pytest.raises(CommandError, match="cannot fetch"):
        pull(Lims(url="http://127.0.0.1:9/lots"))
