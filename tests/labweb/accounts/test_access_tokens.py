"""Programs act in the name of a person with an access token, and never further than it reaches."""

from __future__ import annotations

import json
from datetime import timedelta
from typing import Any

import pytest
from django.db import connection
from django.http import HttpResponse

from labweb.accounts import services
from labweb.accounts.models import AccessToken, AuditEntry
from labweb.common.clock import now
from labweb.domain.approvals.access_tokens import MOST_TOKENS, AccessScope
from tests.builders import PASSWORD, Bench
from tests.labweb.web import call, code_of, read, signed_in

PATH = "/api/v1/tokens"
WANTED = {"name": "nightly figures", "scope": "read", "days": 30}


def made(bench: Bench, scope: AccessScope, who: str = "chemist") -> tuple[AccessToken, str]:
    return services.make_token(
        bench.people[who], lab_id=bench.lab.pk, name=f"script {scope}", scope=scope, days=30
    )


def shown(secret: str, method: str, path: str, body: object = None) -> HttpResponse:
    """Send a request as a program does: without a cookie, with the token in a header."""
    client = signed_in(None)
    client.defaults["HTTP_AUTHORIZATION"] = f"Bearer {secret}"
    return call(client, method, path, body)


def refusal(answer: HttpResponse) -> tuple[int, str]:
    return answer.status_code, code_of(answer)


def test_a_token_is_shown_once_and_opens_what_its_owner_may_see(bench: Bench) -> None:
    client = signed_in(bench.people["chemist"])
    answer = call(client, "POST", PATH, WANTED)
    assert answer.status_code == 201
    told: dict[str, Any] = json.loads(answer.content)
    secret = told["secret"]
    assert secret.startswith("labweb_")
    listed = read(client, PATH)
    assert [row["name"] for row in listed["tokens"]] == ["nightly figures"]
    assert listed["tokens"][0]["used_at"] is None
    assert secret not in json.dumps(listed)
    assert shown(secret, "GET", "/api/v1/runs").status_code == 200
    assert read(client, PATH)["tokens"][0]["used_at"] is not None
    me = json.loads(shown(secret, "GET", "/api/v1/session").content)
    assert me["user"]["username"] == "chemist"


def test_the_secret_stands_nowhere_in_the_database(bench: Bench) -> None:
    _, secret = made(bench, AccessScope.READ)
    with connection.cursor() as cursor:
        cursor.execute("SELECT count(*) FROM accounts_accesstoken t WHERE t::text LIKE %s",
                       [f"%{secret}%"])  # fmt: skip
        assert cursor.fetchone() == (0,)
    entry = AuditEntry.objects.filter(action="token.make").latest("id")
    assert secret not in json.dumps(entry.detail)
    assert entry.detail["scope"] == "read"


def test_a_token_that_is_not_valid_opens_nothing(bench: Bench) -> None:
    row, secret = made(bench, AccessScope.READ)
    assert refusal(shown("labweb_guess", "GET", "/api/v1/runs")) == (401, "http.token_refused")
    assert refusal(shown("something else", "GET", "/api/v1/runs"))[0] == 401
    rows = AccessToken.objects.filter(pk=row.pk)
    rows.update(expires_at=now() - timedelta(seconds=1))
    assert refusal(shown(secret, "GET", "/api/v1/runs")) == (401, "http.token_refused")
    rows.update(expires_at=now() + timedelta(days=1), revoked_at=now())
    assert refusal(shown(secret, "GET", "/api/v1/runs")) == (401, "http.token_refused")
    rows.update(revoked_at=None)
    bench.people["chemist"].is_active = False
    bench.people["chemist"].save()
    assert refusal(shown(secret, "GET", "/api/v1/runs")) == (401, "http.token_refused")


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("POST", PATH, WANTED),
        ("POST", "/api/v1/session/password", {"old": PASSWORD, "new": "another-passphrase"}),
        ("POST", "/api/v1/session/confirm", {"password": PASSWORD}),
        ("POST", "/api/v1/lab/reset", {"reason": "all clear"}),
        ("POST", "/api/v1/join-tokens", {"name": "Bench 9"}),
        ("DELETE", "/api/v1/session", None),
    ],
)
def test_no_token_does_what_a_person_has_to_do(
    bench: Bench, method: str, path: str, body: object
) -> None:
    _, secret = made(bench, AccessScope.SUBMIT, "admin")
    assert refusal(shown(secret, method, path, body)) == (403, "token.not_by_token")


def test_each_scope_holds_those_before_it() -> None:
    for place, scope in enumerate(AccessScope):
        assert [scope.holds(other) for other in AccessScope] == [
            number <= place for number, _ in enumerate(AccessScope)
        ]


def test_a_token_is_revoked_by_its_owner_or_an_admin(bench: Bench) -> None:
    row, secret = made(bench, AccessScope.READ)
    path = f"{PATH}/{row.pk}"
    other = call(signed_in(bench.people["approver"]), "DELETE", path)
    assert refusal(other) == (403, "token.of_another")
    assert shown(secret, "GET", "/api/v1/runs").status_code == 200
    admin = signed_in(bench.people["admin"])
    assert [row["owner"] for row in read(admin, f"{PATH}?of=all")["tokens"]] == [
        bench.people["chemist"].printed_name
    ]
    assert call(admin, "DELETE", path).status_code == 204
    assert call(signed_in(bench.people["chemist"]), "DELETE", path).status_code == 204
    assert refusal(shown(secret, "GET", "/api/v1/runs")) == (401, "http.token_refused")
    assert AuditEntry.objects.filter(action="token.revoke").count() == 1
    seen = call(signed_in(bench.people["approver"]), "GET", f"{PATH}?of=all")
    assert refusal(seen) == (403, "token.of_another")


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"name": "  "}, "token.name"),
        ({"name": "n" * 101}, "token.name"),
        ({"days": 0}, "token.days"),
        ({"days": 367}, "token.days"),
        ({"scope": "everything"}, "http.body"),
    ],
)
def test_what_is_no_token_is_refused(bench: Bench, change: dict[str, Any], code: str) -> None:
    client = signed_in(bench.people["chemist"])
    assert refusal(call(client, "POST", PATH, WANTED | change)) == (422, code)
    assert read(client, PATH)["tokens"] == []


def test_a_name_is_given_once_and_nobody_has_too_many(bench: Bench) -> None:
    client = signed_in(bench.people["chemist"])
    for number in range(MOST_TOKENS):
        assert call(client, "POST", PATH, WANTED | {"name": f"t{number}"}).status_code == 201
    again = call(client, "POST", PATH, WANTED | {"name": "t3"})
    assert refusal(again) == (409, "token.name_taken")
    assert refusal(call(client, "POST", PATH, WANTED)) == (409, "token.too_many")
    first = read(client, PATH)["tokens"][-1]
    assert call(client, "DELETE", f"{PATH}/{first['id']}").status_code == 204
    assert call(client, "POST", PATH, WANTED | {"name": first["name"]}).status_code == 201


def test_a_token_is_no_session_and_needs_no_cookie(bench: Bench) -> None:
    _, secret = made(bench, AccessScope.READ)
    answer = shown(secret, "GET", "/api/v1/runs")
    assert "sessionid" not in answer.cookies
    assert refusal(call(signed_in(None), "GET", "/api/v1/runs"))[0] == 403


REACH = [
    ("POST", "/api/v1/workflows", {"name": "By a script"}, AccessScope.DRAFT),
    ("POST", "/api/v1/lab/stop", {}, AccessScope.SIMULATE),
]


@pytest.mark.parametrize(("method", "path", "body", "needed"), REACH)
@pytest.mark.parametrize("scope", AccessScope)
def test_a_scope_reaches_as_far_as_it_says(
    bench: Bench, scope: AccessScope, method: str, path: str, body: object, needed: AccessScope
) -> None:
    _, secret = made(bench, scope)
    answer = shown(secret, method, path, body)
    if scope.holds(needed):
        assert answer.status_code < 300, answer.content
    else:
        assert refusal(answer) == (403, "token.scope")


def test_a_live_lab_needs_more_than_a_simulated_one(bench: Bench) -> None:
    body = {"version_id": str(bench.version("Move 5 mL of water").id)}
    _, simulates = made(bench, AccessScope.SIMULATE)
    _, submits = made(bench, AccessScope.SUBMIT)
    bench.lab.mode = "live"
    bench.lab.save()
    assert refusal(shown(simulates, "POST", "/api/v1/runs", body)) == (403, "token.scope")
    assert shown(submits, "POST", "/api/v1/runs", body).status_code == 201


def test_a_token_aborts_the_runs_of_its_owner_alone(bench: Bench) -> None:
    body = {"version_id": str(bench.version("Move 5 mL of water").id)}
    _, own = made(bench, AccessScope.SIMULATE)
    _, other = made(bench, AccessScope.SUBMIT, "approver")
    run = json.loads(shown(own, "POST", "/api/v1/runs", body).content)
    path = f"/api/v1/runs/{run['id']}/abort"
    refused = shown(other, "POST", path, {"reason": "mine"})
    assert refusal(refused) == (403, "token.not_by_token")
    assert shown(own, "POST", path, {"reason": "no longer needed"}).status_code == 200


def test_another_password_revokes_the_tokens(bench: Bench) -> None:
    chemist = bench.people["chemist"]
    _, secret = made(bench, AccessScope.READ)
    services.change_password(chemist, old=PASSWORD, new="another-long-passphrase")
    assert refusal(shown(secret, "GET", "/api/v1/runs")) == (401, "http.token_refused")
    chemist.refresh_from_db()
    _, secret = made(bench, AccessScope.DRAFT)
    services.note_foreign_password(chemist)
    assert refusal(shown(secret, "GET", "/api/v1/runs")) == (401, "http.token_refused")


def test_the_audit_trail_says_by_which_token_it_was(bench: Bench) -> None:
    row, secret = made(bench, AccessScope.SIMULATE)
    assert shown(secret, "POST", "/api/v1/lab/stop", {}).status_code == 200
    entry = AuditEntry.objects.filter(action="lab.stop").latest("id")
    assert entry.detail["token"] == {"id": str(row.pk), "name": row.name}
