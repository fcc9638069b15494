"""A signature proves something: only its owner knows a password, and typed it lately."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import timedelta
from uuid import uuid4

import pytest
from django.test import Client
from pytest_django import Settings

from labweb.accounts.models import AuditEntry, Grant, User
from labweb.api.access.password_attempts import MOST_FAILURES
from labweb.common.database import sessions
from labweb.runs.models import Run
from tests.builders import HEAT, PASSWORD, Bench, a_started_run
from tests.labweb.web import call, code_of, read, signed_in

NEW = "another-long-passphrase"


def with_password(user: User, password: str = PASSWORD) -> User:
    user.set_password(password)
    user.save()
    return user


def signs_in(name: str, password: str) -> tuple[Client, int]:
    client = Client(raise_request_exception=False)
    body = {"username": name, "password": password}
    return client, call(client, "POST", "/api/v1/session", body).status_code


def changes(client: Client, old: str, new: str) -> tuple[int, str]:
    answer = call(client, "POST", "/api/v1/session/password", {"old": old, "new": new})
    return answer.status_code, "" if answer.status_code == 200 else code_of(answer)


@pytest.mark.parametrize("role", ["observer", "chemist", "approver", "admin"])
def test_everybody_changes_their_own_password(bench: Bench, role: str) -> None:
    user = with_password(bench.people[role])
    client, _ = signs_in(user.username, PASSWORD)
    assert changes(client, PASSWORD, NEW) == (200, "")
    assert read(client, "/api/v1/lab")["id"]
    assert signs_in(user.username, PASSWORD)[1] == 403
    assert signs_in(user.username, NEW)[1] == 200


def test_a_change_ends_the_other_sessions(bench: Bench) -> None:
    user = with_password(bench.people["chemist"])
    other, _ = signs_in(user.username, PASSWORD)
    client, _ = signs_in(user.username, PASSWORD)
    changes(client, PASSWORD, NEW)
    assert call(other, "GET", "/api/v1/lab").status_code == 403


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("wrong", NEW, "session.wrong"),
        (PASSWORD, PASSWORD, "session.same_password"),
        (PASSWORD, "short", "session.weak_password"),
        (PASSWORD, "12345678901234", "session.weak_password"),
    ],
)
def test_a_password_that_cannot_be_is_refused_and_the_old_one_stays(
    bench: Bench, old: str, new: str, code: str
) -> None:
    user = with_password(bench.people["chemist"])
    client, _ = signs_in(user.username, PASSWORD)
    assert changes(client, old, new)[1] == code
    assert signs_in(user.username, PASSWORD)[1] == 200


def test_a_password_that_an_admin_set_is_changed_before_anything_else(bench: Bench) -> None:
    user = bench.people["chemist"]
    admin = signed_in(bench.people["admin"])
    address = f"/admin/accounts/user/{user.pk}/password/"
    sent = {"password1": NEW, "password2": NEW, "usable_password": "true"}
    assert admin.post(address, sent).status_code == 302
    client, status = signs_in(user.username, NEW)
    assert status == 200
    assert code_of(call(client, "GET", "/api/v1/lab")) == "session.password_due"
    assert code_of(call(client, "POST", "/api/v1/lab/stop", {})) == "session.password_due"
    changes(client, NEW, PASSWORD)
    assert read(client, "/api/v1/lab")["id"]


def test_who_was_granted_nothing_reads_nothing(bench: Bench) -> None:
    stranger = User.objects.create_user("stranger", password=PASSWORD)
    for path in ("lab", "home", "workflows", "drivers", "hosts", "runs", "approvals", "steps"):
        assert code_of(call(signed_in(stranger), "GET", f"/api/v1/{path}")) == "http.no_role"


def one_bench(bench: Bench) -> User:
    """Somebody who may see one vessel of the lab and nothing else."""
    user = User.objects.create_user("guest", password=PASSWORD)
    Grant.objects.create(user=user, role="observer", resource=bench.node("water"))
    return user


def test_who_sees_a_part_of_the_lab_reads_no_workflow_about_the_rest(bench: Bench) -> None:
    client = signed_in(one_bench(bench))
    version = bench.version(HEAT)
    assert call(client, "GET", f"/api/v1/workflows/{version.workflow_id}").status_code == 404
    number = f"/api/v1/workflows/{version.workflow_id}/versions/{version.number}"
    assert call(client, "GET", number).status_code == 404
    names = [row["name"] for row in read(client, "/api/v1/workflows")["workflows"]]
    assert HEAT not in names
    assert read(client, "/api/v1/drivers")["drivers"] == []


def test_a_refusal_tells_a_stranger_no_name(bench: Bench) -> None:
    client = signed_in(one_bench(bench))
    host = bench.host
    for act in ("fence", "revoke", "readmit"):
        answer = call(client, "POST", f"/api/v1/hosts/{host.id}/{act}", {"reason": "because"})
        assert answer.status_code in {403, 404}
        assert host.name not in answer.content.decode()


# --- acts that are signed ---


def grown_stale(client: Client) -> Client:
    session = client.session
    session["confirmed_at"] = time.time() - sessions.CONFIRMED_FOR_S - 1
    session.save()
    return client


SIGNED: dict[str, Callable[[], dict[str, object]]] = {
    "approvals/{id}/decision": lambda: {"is_approved": True},
    "drivers/{id}/decision": lambda: {"is_approved": True},
    "calibrations/{id}/decision": lambda: {"is_accepted": True},
    "jobs/{id}/resolve": lambda: {"answer": "did_not", "note": "looked"},
    "join-requests/{id}/admit": lambda: {"code": "a", "reason": "stood there"},
    "hosts/{id}/fence": lambda: {"reason": "burnt"},
    "hosts/{id}/revoke": lambda: {"reason": "stolen"},
    "hosts/{id}/readmit": lambda: {"reason": "looked"},
}


@pytest.mark.parametrize("path", SIGNED)
def test_an_act_that_is_signed_asks_for_the_password_again(bench: Bench, path: str) -> None:
    client = grown_stale(signed_in(with_password(bench.people["admin"])))
    address = f"/api/v1/{path.format(id=uuid4())}"
    assert code_of(call(client, "POST", address, SIGNED[path]())) == "session.confirm"
    call(client, "POST", "/api/v1/session/confirm", {"password": PASSWORD})
    assert code_of(call(client, "POST", address, SIGNED[path]())) != "session.confirm"


def test_a_wrong_password_signs_nothing(bench: Bench) -> None:
    client = grown_stale(signed_in(with_password(bench.people["approver"])))
    answer = call(client, "POST", "/api/v1/session/confirm", {"password": "wrong"})
    assert code_of(answer) == "session.wrong"
    path = f"/api/v1/approvals/{uuid4()}/decision"
    assert code_of(call(client, "POST", path, {"is_approved": True})) == "session.confirm"


def test_what_is_signed_keeps_the_printed_name_and_the_meaning(bench: Bench) -> None:
    run: Run = a_started_run(bench, HEAT)
    request_id = read(signed_in(bench.people["approver"]), f"/api/v1/runs/{run.id}")["approval"][
        "id"
    ]
    approver = signed_in(bench.people["approver"])
    call(approver, "POST", f"/api/v1/approvals/{request_id}/decision", {"is_approved": True})
    detail = AuditEntry.objects.get(action="approval.decide").detail
    assert detail["printed_name"] == bench.people["approver"].printed_name
    assert detail["meaning"] == "approves the start"


def test_a_change_on_the_admin_pages_is_signed_and_keeps_what_was_filled_in(bench: Bench) -> None:
    client = grown_stale(signed_in(with_password(bench.people["admin"])))
    sent = {"username": "new", "password1": NEW, "password2": NEW, "usable_password": "true"}
    asked = client.post("/admin/accounts/user/add/", sent)
    assert asked.status_code == 403
    assert b'name="username" value="new"' in asked.content
    assert not User.objects.filter(username="new").exists()
    wrong = client.post("/admin/accounts/user/add/", {**sent, "confirm_password": "wrong"})
    assert b"The password is wrong" in wrong.content
    done = client.post("/admin/accounts/user/add/", {**sent, "confirm_password": PASSWORD})
    assert done.status_code == 302
    assert User.objects.get(username="new").password_from == "admin"


def test_a_wrong_password_on_the_admin_pages_counts_as_one_of_a_sign_in(bench: Bench) -> None:
    admin = with_password(bench.people["admin"])
    client = grown_stale(signed_in(admin))
    sent = {"username": "new", "password1": NEW, "password2": NEW, "usable_password": "true"}
    for _ in range(MOST_FAILURES):
        wrong = client.post("/admin/accounts/user/add/", {**sent, "confirm_password": "wrong"})
        assert (wrong.status_code, b"The password is wrong" in wrong.content) == (403, True)
    right = client.post("/admin/accounts/user/add/", {**sent, "confirm_password": PASSWORD})
    assert (right.status_code, 290 <= int(right["Retry-After"]) <= 300) == (429, True)
    assert b"try again in 5 minutes" in right.content
    assert b"The password is wrong" not in right.content
    assert not User.objects.filter(username="new").exists()
    again = call(client, "POST", "/api/v1/session/confirm", {"password": PASSWORD})
    assert again.status_code == 429, "the two ways are counted together"
    failed = AuditEntry.objects.filter(action="session.refuse", subject=str(admin.pk))
    assert failed.count() == MOST_FAILURES


# --- a session that nobody uses ---


def idle(client: Client, by: timedelta) -> Client:
    session = client.session
    session["acted_at"] = time.time() - by.total_seconds()
    session.save()
    return client


def test_a_session_that_nobody_uses_ends(bench: Bench, settings: Settings) -> None:
    settings.SESSION_IDLE_S = 600
    client = signed_in(bench.people["chemist"])
    assert read(idle(client, timedelta(minutes=9)), "/api/v1/lab")["id"]
    answer = call(idle(client, timedelta(minutes=11)), "GET", "/api/v1/lab")
    assert (answer.status_code, code_of(answer)) == (403, "http.not_authenticated")


def test_a_page_that_asks_by_itself_keeps_no_session_open(bench: Bench) -> None:
    client = idle(signed_in(bench.people["chemist"]), timedelta(minutes=9))
    before = client.session["acted_at"]
    read(client, "/api/v1/lab")
    assert client.session["acted_at"] == before
    assert call(client, "POST", "/api/v1/session/awake").status_code == 204
    assert client.session["acted_at"] > before


def test_no_idle_time_is_wanted_where_the_setting_is_nought(
    bench: Bench, settings: Settings
) -> None:
    settings.SESSION_IDLE_S = 0
    client = idle(signed_in(bench.people["chemist"]), timedelta(days=9))
    assert read(client, "/api/v1/lab")["id"]
