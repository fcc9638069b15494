"""Who was refused stands in the audit trail."""

from __future__ import annotations

import json

from django.test import Client

from labweb.accounts.models import AuditEntry
from labweb.approvals.models import Policy
from tests.builders import PASSWORD, Bench
from tests.labweb.web import call, signed_in


def newest(action: str) -> AuditEntry:
    return AuditEntry.objects.filter(action=action).latest("id")


def sign_in(client: Client, name: str, password: str) -> int:
    body = {"username": name, "password": password}
    return call(client, "POST", "/api/v1/session", body).status_code


def test_a_wrong_password_is_written_down_with_the_user_and_the_address(bench: Bench) -> None:
    chemist = bench.people["chemist"]
    assert sign_in(Client(REMOTE_ADDR="127.0.0.9"), chemist.username, "wrong") == 403
    entry = newest("session.refuse")
    assert (entry.subject, entry.actor) == (str(chemist.pk), None)
    assert entry.detail == {"address": "127.0.0.9", "is_name_known": True}


def test_what_was_typed_in_place_of_a_name_is_not_written_down(bench: Bench) -> None:
    assert sign_in(Client(), "my-secret-password", "x") == 403
    entry = newest("session.refuse")
    assert "my-secret-password" not in json.dumps([entry.subject, entry.reason, entry.detail])


def test_who_signs_out_is_written_down(bench: Bench) -> None:
    chemist = bench.people["chemist"]
    chemist.set_password(PASSWORD)
    chemist.save()
    client = Client()
    assert sign_in(client, chemist.username, PASSWORD) == 200
    assert call(client, "DELETE", "/api/v1/session").status_code == 204
    assert newest("session.close").actor == chemist


def test_what_a_person_may_not_do_is_written_down(bench: Bench) -> None:
    path = "/api/v1/lab/reset"
    observer = bench.people["observer"]
    answer = call(signed_in(observer), "POST", path, {"reason": "because"})
    assert answer.status_code == 403
    entry = newest("access.refuse")
    assert (entry.actor, entry.subject, entry.detail["method"]) == (observer, path, "POST")


def test_the_rule_that_a_policy_had_before_is_written_down(bench: Bench) -> None:
    policy = Policy.objects.first()
    assert policy is not None
    was = dict(policy.rule)
    rule = {**was, "temperature_c": 80.0} if "temperature_c" in was else was
    data = {
        "lab": str(policy.lab_id),
        "name": "Another name",
        "rule": json.dumps(rule),
        "is_active": "on",
    }
    client = signed_in(bench.people["admin"])
    answer = client.post(f"/admin/approvals/policy/{policy.pk}/change/", data)
    assert answer.status_code == 302, answer.content[:300]
    detail = newest("policy.change").detail
    assert (detail["before"]["name"], detail["before"]["rule"]) == (policy.name, was)
    assert detail["name"] == "Another name"
