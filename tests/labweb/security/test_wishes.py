"""One wish has one effect: all that acts, without a key, with one, and with one that was used.

What acts is read from the URLs themselves; bodies that are right stand in the table of who may.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import re
import time
from collections import Counter
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from django.apps import apps
from django.core.files.uploadedfile import SimpleUploadedFile
from django.db.transaction import atomic, set_rollback
from django.test import Client
from pytest_django import Settings

from labweb.accounts.api import Endpoint, acts
from labweb.accounts.models import KeptAnswer
from tests.builders import Bench
from tests.labweb.instrument_files import TRACE
from tests.labweb.photos import a_photo
from tests.labweb.security.rest_table import API, Form
from tests.labweb.security.test_matrix import name_of, prepare
from tests.labweb.security.things import one_of_each
from tests.labweb.web import KEY, call, code_of, routes, signed_in

SECRET = "s" * 40
A_LOT = {
    "lot": "w9", "material": "water", "phase": "liquid", "vessel": "flask_1", "amount": "2 mL",
}  # fmt: skip

HARMLESS = {
    ("POST", "session"),
    ("DELETE", "session"),
    ("POST", "session/password"),
    ("POST", "session/confirm"),
    ("POST", "session/awake"),
    ("POST", "lab/stop"),
    ("POST", "devices/<stopped>/stop"),
    ("POST", "drivers/reading"),
    ("POST", "operations/check"),
    ("POST", "workflows/check"),
    ("POST", "recipes/open"),
    ("POST", "recipes/advise"),
}
"""What a second time does no more than the first; anything else needs a key."""

UNSAFE = ("post", "put", "patch", "delete")


def unsafe() -> list[tuple[str, str, Any]]:
    """List the unsafe methods of every URL below `/api/`, with the view."""
    return [
        (method.upper(), name_of(route), view.cls)
        for route, view in routes()
        if route.startswith("api/v1/")
        for method in UNSAFE
        if hasattr(view.cls, method)
    ]


ACTING = [(m, r) for m, r, view in unsafe() if acts(view, m.lower())]


@pytest.fixture
def ids(bench: Bench, settings: Settings, tmp_path: Path) -> dict[str, str]:
    settings.DATA_DIR, settings.LIMS_SECRET, settings.LIMS_USER = tmp_path, SECRET, "chemist"
    return one_of_each(bench)


class Request:
    """One request that acts, ready to be sent as often as one likes."""

    def __init__(self, bench: Bench, method: str, route: str, ids: dict[str, str]) -> None:
        allowed, body = API[method, route]
        self.client = signed_in(bench.people[allowed[0]] if allowed else None)
        self.method = method
        self.path = "/api/v1/" + re.sub(r"<(\w+)>", lambda found: ids[found[1]], route)
        self.is_form = isinstance(body, Form)
        self.content = a_photo("blue") if route.endswith("photo") else TRACE.encode() + b"3,1,1,"
        self.body = {"lots": [A_LOT]} if route == "deliveries" else body
        if isinstance(self.body, dict):
            text = re.sub(r'"<(\w+)>"', lambda found: f'"{ids[found[1]]}"', json.dumps(self.body))
            self.body = json.loads(text)

    def send(self, key: str, *, changed: bool = False) -> Any:  # noqa: ANN401 - a response
        named: dict[str, Any] = {KEY: key}
        if self.is_form:
            file = SimpleUploadedFile("b.csv", self.content + b" " * changed)
            return self.client.post(self.path, {**self.body, "file": file}, **named)
        body = {**(self.body or {}), "changed": 1} if changed else self.body
        if self.path.endswith("deliveries"):
            return _signed(self.client, self.path, body, key)
        return call(self.client, self.method, self.path, body, key)


def _signed(client: Client, path: str, body: Any, key: str) -> Any:  # noqa: ANN401 - a response
    raw = json.dumps(body).encode()
    stamp = f"{time.time():.0f}"
    mac = hmac.new(SECRET.encode(), f"{stamp}.".encode() + raw, hashlib.sha256).hexdigest()
    signed: dict[str, Any] = {"HTTP_X_LABWEB_SIGNATURE": f"t={stamp},v1={mac}", KEY: key}
    return client.generic("POST", path, raw, content_type="application/json", **signed)


def rows() -> Counter[str]:
    """Count the rows of every table."""
    return Counter({model._meta.label: model._base_manager.count() for model in apps.get_models()})


def test_every_unsafe_method_either_needs_a_key_or_says_why_it_needs_none() -> None:
    assert {(m, r) for m, r, _ in unsafe()} - set(ACTING) == HARMLESS
    for method, route, view in unsafe():
        assert issubclass(view, Endpoint), f"{method} {route} is guarded by nobody"
        assert (method, route) in ACTING or len(view.harmless[method.lower()]) > 20
    assert {(m, r) for m, r, _ in unsafe()} <= set(API), "no body is known for one of them"
    assert len(ACTING) > 35


def test_what_acts_without_a_key_is_refused_and_changes_nothing(
    bench: Bench, ids: dict[str, str]
) -> None:
    wrong = []
    for method, route in ACTING:
        with atomic():
            prepare(bench, route, ids)
            request = Request(bench, method, route, ids)
            before = rows()
            for key, code in (("", "http.key_missing"), ("short", "http.key_malformed")):
                answer = request.send(key)
                if (answer.status_code, code_of(answer)) != (400, code) or rows() != before:
                    wrong.append((method, route, answer.status_code, answer.content[:200]))
            set_rollback(True)
    assert not wrong


def test_the_same_wish_twice_is_carried_out_once_and_answered_alike(
    bench: Bench, ids: dict[str, str]
) -> None:
    wrong: list[tuple[Any, ...]] = []
    for method, route in ACTING:
        with atomic():
            prepare(bench, route, ids)
            request, key = Request(bench, method, route, ids), str(uuid4())
            first = request.send(key)
            after = rows()
            second = request.send(key)
            is_alike = first.content == second.content and first.status_code == second.status_code
            if first.status_code >= 400 or not is_alike or rows() != after:
                wrong.append((method, route, first.status_code, second.status_code, second.content))
            if "Idempotency-Replayed" in first or second.get("Idempotency-Replayed") != "true":
                wrong.append((method, route, dict(first.headers), dict(second.headers)))
            set_rollback(True)
    assert not wrong


def test_a_key_that_named_another_wish_is_refused_and_changes_nothing(
    bench: Bench, ids: dict[str, str]
) -> None:
    wrong: list[tuple[Any, ...]] = []
    for method, route in ACTING:
        with atomic():
            prepare(bench, route, ids)
            request, key = Request(bench, method, route, ids), str(uuid4())
            request.send(key)
            after = rows()
            answer = request.send(key, changed=True)
            if (answer.status_code, code_of(answer)) != (409, "http.key_reused"):
                wrong.append((method, route, answer.status_code, answer.content[:200]))
            if rows() != after:
                wrong.append((method, route, rows() - after))
            set_rollback(True)
    assert not wrong


def test_the_key_of_one_person_is_not_the_key_of_another(bench: Bench) -> None:
    key, path, wanted = str(uuid4()), "/api/v1/workflows", {"name": "Mine"}
    made = [
        call(signed_in(bench.people[name]), "POST", path, wanted, key)
        for name in ("chemist", "approver")
    ]
    assert [answer.status_code for answer in made] == [201, 201]
    assert len({answer.content for answer in made}) == 2


def test_what_is_kept_tells_nobody_without_the_key_what_was_answered(bench: Bench) -> None:
    key, admin = str(uuid4()), signed_in(bench.people["admin"])
    made = call(admin, "POST", "/api/v1/join-tokens", {"name": "Bench 9"}, key)
    token = str(json.loads(made.content)["token"])
    (row,) = KeptAnswer.objects.all()
    kept = bytes(row.sealed)
    assert token.encode() not in kept
    assert key not in f"{row.key_digest} {row.request_digest}"
