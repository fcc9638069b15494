"""Requests that are wrong, too large, forged or too many."""

from __future__ import annotations

import json
from hashlib import sha256
from typing import Any

import pytest
from django.contrib.sessions.models import Session
from django.test import Client

from labweb.runs.models import Run
from labweb.workflows.models import Workflow
from tests.builders import PASSWORD, Bench
from tests.labweb.web import Keyed, call, code_of, signed_in

API = "/api/v1"


@pytest.fixture
def chemist(bench: Bench) -> Client:
    return signed_in(bench.people["chemist"])


def post(client: Client, path: str, raw: bytes, **headers: Any) -> Any:  # noqa: ANN401
    return client.generic("POST", path, raw, content_type="application/json", **headers)


BAD_BODIES = {
    "no JSON": (b"{", 400, "http.parse_error"),
    "no UTF-8": (b'{"name": "\xff"}', 400, "http.parse_error"),
    "a list": (b"[]", 400, "http.parse_error"),
    "NaN": (b'{"name": NaN}', 400, "http.parse_error"),
    "infinity": (b'{"name": 1e999}', 400, "http.parse_error"),
    "a long integer": (b'{"name": ' + b"9" * 5000 + b"}", 400, "http.parse_error"),
    "U+0000": (b'{"name": "\\u0000"}', 400, "http.parse_error"),
    "half a character": (b'{"name": "\\ud800"}', 400, "http.parse_error"),
    "nested": (b'{"a":' * 40 + b"1" + b"}" * 40, 400, "http.parse_error"),
    "nested deeply": (b"[" * 200_000 + b"]" * 200_000, 400, "http.parse_error"),
    "an unknown field": (b'{"name": "x", "lab": "other"}', 422, "http.body"),
    "a wrong type": (b'{"name": 7}', 422, "http.body"),
    "a missing field": (b"{}", 422, "http.body"),
    "an id that is none": (b'{"name": "x", "copy_of": "1"}', 422, "http.body"),
}


@pytest.mark.parametrize("name", BAD_BODIES)
def test_a_bad_body_gets_its_code_and_changes_nothing(
    bench: Bench, chemist: Client, name: str
) -> None:
    raw, status, code = BAD_BODIES[name]
    before = Workflow.objects.count()
    answer = post(chemist, f"{API}/workflows", raw)
    assert (answer.status_code, code_of(answer)) == (status, code)
    assert json.loads(answer.content)["effect"] == "none"
    assert Workflow.objects.count() == before


def test_fifty_megabytes_are_refused_before_they_are_parsed(chemist: Client) -> None:
    answer = post(chemist, f"{API}/workflows", b'{"name": "' + b"x" * 50_000_000 + b'"}')
    assert (answer.status_code, code_of(answer)) == (413, "http.too_large")


def test_another_sort_of_body_is_refused(chemist: Client) -> None:
    answer = chemist.post(f"{API}/workflows", {"name": "x"})
    assert (answer.status_code, code_of(answer)) == (415, "http.unsupported_media_type")


@pytest.mark.parametrize("kind", [[], {}, None, 5, True, "transfer "])
def test_a_step_whose_kind_is_none_is_a_finding(chemist: Client, kind: object) -> None:
    steps = [{"id": "s", "kind": kind, "params": {}, "position": {"x": 0, "y": 0}}]
    document = {"schema": "labweb.workflow/1", "name": "f", "steps": steps, "edges": []}
    answer = call(chemist, "POST", f"{API}/workflows/check", {"document": document})
    assert answer.status_code == 200
    codes = [finding["code"] for finding in json.loads(answer.content)["findings"]]
    assert codes == ["protocol.unknown_kind"]


@pytest.mark.parametrize(
    "query",
    [
        "limit=0",
        f"limit={'9' * 5000}",
        "limit=501",
        "limit=x",
        "limit=²",
        "state=%00",
        "state=running,open",
    ],
)
def test_a_bad_query_is_refused(chemist: Client, query: str) -> None:
    answer = chemist.get(f"{API}/runs?{query}")
    assert (answer.status_code, code_of(answer)) == (422, "http.query")


@pytest.mark.parametrize("query", ["depth=0", "depth=101", "depth=²", "direction=sideways"])
def test_a_bad_query_for_lineage_is_refused(bench: Bench, chemist: Client, query: str) -> None:
    answer = chemist.get(f"{API}/resources/{bench.node('water').id}/lineage?{query}")
    assert (answer.status_code, code_of(answer)) == (422, "http.query")


@pytest.mark.parametrize("text", ["x" * 5000, "%ff%fe", "'; DROP TABLE", "%25"])
def test_search_takes_any_text(chemist: Client, text: str) -> None:
    assert chemist.get(f"{API}/search?q=ab{text}").status_code == 200


@pytest.mark.parametrize(
    ("method", "path"),
    [("POST", "workflows"), ("POST", "runs"), ("POST", "lab/stop"), ("DELETE", "session")],
)
def test_an_unsafe_call_without_the_token_is_refused(bench: Bench, method: str, path: str) -> None:
    client = Keyed(enforce_csrf_checks=True)
    client.force_login(bench.people["chemist"])
    answer = call(client, method, f"{API}/{path}", {})
    assert (answer.status_code, code_of(answer)) == (403, "http.permission_denied")
    assert not Run.objects.exists()


def test_signing_in_needs_the_token_too(bench: Bench) -> None:
    client = Keyed(enforce_csrf_checks=True)
    body = {"username": "chemist", "password": PASSWORD}
    assert call(client, "POST", f"{API}/session", body).status_code == 403
    client.get(f"{API}/session")
    token = client.cookies["csrftoken"].value
    answer = client.generic(
        "POST",
        f"{API}/session",
        json.dumps(body),
        content_type="application/json",
        HTTP_X_CSRFTOKEN=token,
    )
    assert answer.status_code == 200


def test_a_session_that_has_ended_is_told_so(bench: Bench, chemist: Client) -> None:
    assert call(chemist, "GET", f"{API}/home").status_code == 200
    Session.objects.all().delete()
    answer = call(chemist, "GET", f"{API}/home")
    assert answer.status_code in {401, 403}
    assert code_of(answer) == "http.not_authenticated"


def test_a_user_who_is_disabled_is_out_with_the_next_request(bench: Bench, chemist: Client) -> None:
    user = bench.people["chemist"]
    user.is_active = False
    user.save(update_fields=["is_active"])
    assert code_of(call(chemist, "GET", f"{API}/home")) == "http.not_authenticated"


def sign_in(
    name: str,
    password: str,
    address: str = "192.0.2.1",
    client: Client | None = None,
    **headers: Any,  # noqa: ANN401 - of WSGI's environment
) -> Any:  # noqa: ANN401 - a response of the test client
    body = json.dumps({"username": name, "password": password})
    return (client or Keyed()).generic(
        "POST",
        f"{API}/session",
        body,
        content_type="application/json",
        **{"REMOTE_ADDR": address, **headers},
    )


def test_five_wrong_passwords_close_the_name_to_that_address_alone(bench: Bench) -> None:
    for _ in range(5):
        answer = sign_in("Chemist", "wrong")
        assert (answer.status_code, code_of(answer)) == (403, "session.wrong")
    answer = sign_in("chemist", PASSWORD)
    assert (answer.status_code, code_of(answer)) == (429, "http.throttled")
    assert 290 < int(answer["Retry-After"]) <= 300
    assert json.loads(answer.content)["message"].endswith("try again in 5 minutes")
    assert sign_in("chemist", PASSWORD, address="192.0.2.2").status_code == 200
    assert sign_in("approver", PASSWORD).status_code == 200


def test_strangers_of_many_addresses_lock_no_name_out(bench: Bench) -> None:
    for number in range(60):
        sign_in("chemist", "wrong", address=f"198.51.100.{number}")
    assert sign_in("chemist", PASSWORD, address="192.0.2.2").status_code == 200


def test_a_known_browser_gets_in_though_a_stranger_at_its_address_fails(bench: Bench) -> None:
    browser = Client()
    assert sign_in("chemist", PASSWORD, client=browser).status_code == 200
    for number in range(30):
        sign_in("chemist" if number % 2 else str(number), "wrong")
    assert sign_in("chemist", PASSWORD).status_code == 429
    assert sign_in("chemist", PASSWORD, client=browser).status_code == 200


def test_a_known_browser_tries_no_more_passwords_than_a_stranger(bench: Bench) -> None:
    browser = Client()
    assert sign_in("chemist", PASSWORD, client=browser).status_code == 200
    assert sign_in("approver", "wrong", client=browser).status_code == 403
    for _ in range(5):
        assert sign_in("chemist", "wrong", client=browser).status_code == 403
    assert sign_in("chemist", PASSWORD, client=browser).status_code == 429


def test_a_cookie_that_somebody_made_up_makes_no_browser_known(bench: Bench) -> None:
    known = Client()
    sign_in("approver", PASSWORD, client=known)
    (cookie,) = (one for name, one in known.cookies.items() if name.startswith("labweb_known_"))
    assert (cookie["httponly"], cookie["samesite"]) == (True, "Strict")
    mine = sha256(b"chemist").hexdigest()[:16]
    for value in (cookie.value, cookie.value[:-1], "x", "", "a" * 5000):
        forged = Client()
        forged.cookies[f"labweb_known_{mine}"] = value
        assert sign_in("chemist", "wrong", client=forged).status_code == 403
    assert sign_in("chemist", PASSWORD).status_code == 429


def test_a_header_of_a_stranger_does_not_change_where_the_failures_are_counted(
    bench: Bench,
) -> None:
    for number in range(5):
        told: dict[str, Any] = {"HTTP_X_FORWARDED_FOR": f"203.0.113.{number}"}
        assert sign_in("chemist", "wrong", **told).status_code == 403
    assert sign_in("chemist", PASSWORD, HTTP_X_FORWARDED_FOR="203.0.113.9").status_code == 429


def test_one_address_cannot_try_many_names(bench: Bench) -> None:
    for number in range(20):
        assert sign_in(f"{number}-nobody", "wrong").status_code == 403
    assert sign_in("chemist", PASSWORD).status_code == 429
    assert sign_in("chemist", PASSWORD, address="192.0.2.2").status_code == 200


def test_signing_in_clears_the_count_of_the_name(bench: Bench) -> None:
    for _ in range(4):
        sign_in("chemist", "wrong")
    assert sign_in("chemist", PASSWORD).status_code == 200
    for _ in range(4):
        assert sign_in("chemist", "wrong").status_code == 403


def test_a_refusal_does_not_say_which_of_the_two_was_wrong(bench: Bench) -> None:
    known, unknown = sign_in("chemist", "wrong"), sign_in("nobody", "wrong")
    assert known.content == unknown.content


def test_odd_names_do_not_break_the_count(bench: Bench) -> None:
    for name in ("", " ", "a" * 3000, "名前 \n\t", "x:y"):
        assert sign_in(name, "wrong").status_code == 403
    assert sign_in("chemist", PASSWORD).status_code == 200
