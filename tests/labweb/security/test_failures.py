"""What fails is told in the one shape, without details, whatever failed."""

from __future__ import annotations

import json
import logging
import socket
from typing import Any

import pytest
from django.db import OperationalError, connections
from django.test import Client
from psycopg.errors import DeadlockDetected

from labweb.runs import services
from tests.builders import Bench, a_started_run, an_edge, to_transfer
from tests.labweb.web import Keyed, call, code_of, signed_in

API = "/api/v1"
SHAPE = {"code", "message", "effect", "context", "findings"}


@pytest.fixture
def chemist(bench: Bench) -> Client:
    return signed_in(bench.people["chemist"])


def told(answer: Any) -> dict[str, Any]:  # noqa: ANN401 - each test client has its own response
    found: dict[str, Any] = json.loads(answer.content)
    assert found.keys() == SHAPE
    return found


@pytest.mark.parametrize("method", ["GET", "POST", "PUT", "DELETE"])
@pytest.mark.parametrize(
    "path",
    ["/api/v1/nothing", "/api/v1/runs/7", "/api/v1/runs/x/abort", "/api/v1/", "/api/", "/api/v2/a"],
)
def test_an_address_or_an_id_that_is_none_is_told_in_the_one_shape(path: str, method: str) -> None:
    answer = call(Keyed(), method, path)
    assert answer.status_code == 404
    assert told(answer)["code"] == "http.not_found"


@pytest.mark.parametrize(("method", "effect"), [("GET", "none"), ("POST", "unknown")])
def test_a_failure_nobody_foresaw_is_logged_and_says_no_details(
    chemist: Client,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    method: str,
    effect: str,
) -> None:
    def broken(_self: object, _request: object) -> None:
        raise RuntimeError("password=secret")

    monkeypatch.setattr(f"labweb.runs.api.runs.Runs.{method.lower()}", broken)
    with caplog.at_level(logging.ERROR):
        answer = call(chemist, method, f"{API}/runs", {})
    assert answer.status_code == 500
    found = told(answer)
    assert (found["code"], found["effect"]) == ("http.internal", effect)
    assert "secret" not in answer.content.decode()
    assert "password=secret" in caplog.text


@pytest.fixture
def no_database(db: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Send every new connection to a port at which nobody listens."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    away = connections["default"].copy()
    away.settings_dict |= {"HOST": "127.0.0.1", "PORT": str(port)}
    away.settings_dict["OPTIONS"] = {"connect_timeout": 2}
    monkeypatch.setattr("labweb.api.pages.connection", away)
    monkeypatch.setattr("labweb.runs.api.runs.Runs.get", lambda *_: away.ensure_connection())


def test_a_database_that_is_away_is_a_503(chemist: Client, no_database: None) -> None:
    answer = call(chemist, "GET", f"{API}/runs")
    assert answer.status_code == 503
    assert told(answer)["code"] == "http.unavailable"
    assert call(Keyed(), "GET", "/healthz").status_code == 503


@pytest.fixture
def no_cache(db: None, settings: Any) -> None:  # noqa: ANN401 - pytest-django's
    """Name a Redis that nobody runs."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    cache = {**settings.CACHES["default"], "LOCATION": f"redis://127.0.0.1:{port}/0"}
    settings.CACHES = {"default": cache}


def test_a_redis_that_is_away_is_a_503(no_cache: None) -> None:
    answer = call(Keyed(), "POST", f"{API}/session", {"username": "a", "password": "b"})
    assert answer.status_code == 503
    assert told(answer)["code"] == "http.unavailable"


def test_a_stop_takes_no_arguments_and_needs_none(bench: Bench, chemist: Client) -> None:
    answer = call(chemist, "POST", f"{API}/lab/stop", {"device": "pump_1"})
    assert (answer.status_code, code_of(answer)) == (422, "http.body")
    bench.lab.refresh_from_db()
    assert not bench.lab.is_stopped
    assert call(chemist, "POST", f"{API}/lab/stop").status_code == 200
    bench.lab.refresh_from_db()
    assert bench.lab.is_stopped


@pytest.mark.parametrize(("state", "status"), [("open", 200), ("all", 200), ("bogus", 422)])
def test_requests_are_listed_by_a_state_that_is_offered(
    chemist: Client, state: str, status: int
) -> None:
    answer = call(chemist, "GET", f"{API}/approvals?state={state}")
    assert answer.status_code == status
    assert status == 200 or code_of(answer) == "http.query"


@pytest.mark.parametrize(
    ("moved_ul", "words"),
    [(0.0004, "0.0004 µL is less than a nanolitre"), (5000, "less than the 5 mL")],
)
def test_an_answer_partly_with_an_amount_that_cannot_be_says_what_is_true(
    bench: Bench, moved_ul: float, words: str
) -> None:
    edge = an_edge(bench)
    attempt = to_transfer(a_started_run(bench), edge)
    edge.lose(attempt)
    body = {"answer": "partly", "note": "looked", "moved_ul": moved_ul}
    client = signed_in(bench.people["approver"])
    answer = call(client, "POST", f"{API}/jobs/{attempt.job_id}/resolve", body)
    assert (answer.status_code, code_of(answer)) == (422, "run.bad_amount")
    assert words in told(answer)["message"]


@pytest.mark.parametrize(("failures", "status"), [(1, 200), (2, 200), (3, 503)])
def test_a_stop_that_the_database_gave_up_for_another_transaction_is_tried_again(
    chemist: Client, monkeypatch: pytest.MonkeyPatch, failures: int, status: int
) -> None:
    stop, left = services.stop_lab, [None] * failures

    def given_up_first(**asked: Any) -> Any:  # noqa: ANN401 - as the service takes and returns
        if left:
            left.pop()
            raise OperationalError("deadlock detected") from DeadlockDetected()
        return stop(**asked)

    monkeypatch.setattr(services, "stop_lab", given_up_first)
    assert call(chemist, "POST", f"{API}/lab/stop", {}).status_code == status
