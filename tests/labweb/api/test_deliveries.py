"""A LIMS sends deliveries, and proves by its signature that it was the one."""

from __future__ import annotations

import hashlib
import hmac
import json
import time
from typing import Any

import pytest
from pytest_django import Settings

from labweb.resources.models import Lot
from tests.builders import Bench
from tests.labweb.crutd.hand import held, rows
from tests.labweb.web import Keyed, code_of

SECRET = "s" * 40
ROW = {
    "lot": "w7", "material": "water", "phase": "liquid", "vessel": "flask_1", "amount": "2 mL",
}  # fmt: skip


@pytest.fixture(autouse=True)
def _door(settings: Settings) -> None:
    settings.LIMS_SECRET = SECRET
    settings.LIMS_USER = "chemist"


def sent(
    body: object, *, secret: str = SECRET, at: float | None = None, header: str | None = None
) -> Any:  # noqa: ANN401 - the response of the test client
    raw = json.dumps(body).encode()
    stamp = str(int(time.time() if at is None else at))
    mac = hmac.new(secret.encode(), f"{stamp}.".encode() + raw, hashlib.sha256).hexdigest()
    told = f"t={stamp},v1={mac}" if header is None else header
    return Keyed().post(
        "/api/v1/deliveries", raw, content_type="application/json",
        headers={"X-Labweb-Signature": told},
    )  # fmt: skip


def test_a_signed_delivery_is_received_in_the_name_of_its_user(bench: Bench) -> None:
    answer = sent({"lots": [ROW, ROW | {"vessel": "reactor_1", "amount": "1 mL"}]})
    assert answer.status_code == 201, answer.content
    assert answer.json()["lots"] == [{"id": str(Lot.objects.get(key="w7").id), "key": "w7"}]
    assert held(bench, "flask_1") == {"w7": (2_000_000, 0)}
    assert held(bench, "reactor_1") == {"w7": (1_000_000, 0)}


def test_a_delivery_that_comes_twice_is_refused_the_second_time(bench: Bench) -> None:
    assert sent({"lots": [ROW]}).status_code == 201
    before = rows()
    answer = sent({"lots": [ROW]})
    assert (answer.status_code, code_of(answer)) == (422, "lots.invalid")
    (finding,) = answer.json()["findings"]
    assert (finding["subject"], finding["code"]) == ("row 1", "crutd.lot_received_twice")
    assert rows() == before


@pytest.mark.parametrize(
    ("how", "code"),
    [
        ({"secret": "x" * 40}, "lims.bad_signature"),
        ({"at": 1.0}, "lims.bad_signature"),
        ({"at": 9e9}, "lims.bad_signature"),
        ({"header": "t=1,v1=zz"}, "lims.bad_signature"),
        ({"header": ""}, "http.not_authenticated"),
    ],
)
def test_who_did_not_sign_it_now_delivers_nothing(
    bench: Bench, how: dict[str, Any], code: str
) -> None:
    before = rows()
    answer = sent({"lots": [ROW]}, **how)
    assert (answer.status_code, code_of(answer)) == (403, code)
    assert rows() == before


@pytest.mark.parametrize(("name", "value"), [("LIMS_SECRET", "short"), ("LIMS_USER", "")])
def test_the_door_is_closed_until_secret_and_user_are_set(
    bench: Bench, settings: Settings, name: str, value: str
) -> None:
    setattr(settings, name, value)
    answer = sent({"lots": [ROW]}, secret=settings.LIMS_SECRET)
    assert code_of(answer) == "http.not_authenticated"


def test_its_user_receives_only_where_they_may(bench: Bench, settings: Settings) -> None:
    settings.LIMS_USER = "observer"
    assert code_of(sent({"lots": [ROW]})) == "governance.forbidden"
    settings.LIMS_USER = "nobody"
    assert code_of(sent({"lots": [ROW]})) == "lims.no_user"


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ({"lots": []}, "lots.invalid"),
        ({"lots": [{"lot": "w7"}]}, "lots.invalid"),
        ({"lots": [ROW | {"colour": "red"}]}, "lots.invalid"),
        ({"lots": [ROW | {"amount": 2}]}, "http.body"),
        ({"lots": [ROW], "more": 1}, "http.body"),
        ({"lots": [ROW | {"amount": "2"}]}, "lots.invalid"),
    ],
)
def test_a_delivery_that_is_wrong_changes_nothing(
    bench: Bench, body: dict[str, Any], code: str
) -> None:
    before = rows()
    answer = sent(body)
    assert (answer.status_code, code_of(answer)) == (422, code)
    assert rows() == before
