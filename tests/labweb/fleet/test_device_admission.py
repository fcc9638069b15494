"""The page on which an admin admits a device."""

from __future__ import annotations

import pytest
from django.test import Client

from labweb.accounts.models import AuditEntry, Grant
from tests.builders import Bench, a_lab, a_user
from tests.labweb.web import signed_in


@pytest.fixture
def found(db: None) -> Bench:
    return a_lab(discovered=["ph_1"])


def url_of(bench: Bench, key: str = "ph_1") -> str:
    return f"/admin/enrollment/device/{bench.device(key).id}/review/"


@pytest.fixture
def admin(found: Bench) -> Client:
    return signed_in(found.people["admin"])


def test_the_review_says_what_it_is_what_it_may_do_and_where_it_belongs(
    found: Bench, admin: Client
) -> None:
    text = admin.get(url_of(found, "heater_1")).content.decode()
    device = found.device("heater_1")
    for fact in (
        device.host.name,
        device.transport,
        device.driver.class_name,
        device.driver.digest,
        "heat",
        "temperature_c",
        "°C",
        "a person has to look",
        "Starter lab / Bench 1 /",
        "keeps every rule",
    ):
        assert fact in text, fact


def test_a_candidate_is_admitted_with_a_reason_and_then_can_be_suspended(
    found: Bench, admin: Client
) -> None:
    assert 'value="suspend"' not in admin.get(url_of(found)).content.decode()
    answer = admin.post(
        url_of(found),
        {
            "act": "admit",
            "reason": "label 0815 compared",
            "seen": found.device("ph_1").driver.digest,
        },
    )
    assert (answer.status_code, answer["Location"]) == (302, url_of(found))
    assert found.device("ph_1").state == "enrolled"
    assert AuditEntry.objects.get(action="device.admit").reason == "label 0815 compared"
    page = admin.get(url_of(found)).content.decode()
    assert 'value="suspend"' in page
    assert 'value="admit"' not in page
    admin.post(url_of(found), {"act": "suspend", "reason": "drifts"})
    assert found.device("ph_1").state == "suspended"


def test_nobody_admits_a_driver_that_the_page_did_not_show(found: Bench, admin: Client) -> None:
    assert f'name="seen" value="{found.device("ph_1").driver.digest}"' in (
        admin.get(url_of(found)).content.decode()
    )
    for act in ("admit", "read_only"):
        for seen in ({"seen": "0" * 64}, {}):
            answer = admin.post(url_of(found), {"act": act, "reason": "compared", **seen})
            assert answer.status_code == 422
            assert "not the one that the page showed" in answer.content.decode()
    assert found.device("ph_1").state == "candidate"
    assert not AuditEntry.objects.filter(action="device.admit").exists()


def test_without_a_reason_nothing_happens_and_the_page_says_so(found: Bench, admin: Client) -> None:
    digest = found.device("ph_1").driver.digest
    answer = admin.post(url_of(found), {"act": "admit", "reason": "  ", "seen": digest})
    assert answer.status_code == 422
    assert "the reason is empty" in answer.content.decode()
    assert found.device("ph_1").state == "candidate"


def test_an_act_that_is_none_is_refused(found: Bench, admin: Client) -> None:
    answer = admin.post(url_of(found), {"act": "melt", "reason": "old"})
    assert answer.status_code == 403
    assert found.device("ph_1").state == "candidate"


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_other_roles_may_neither_read_nor_decide(found: Bench, role: str) -> None:
    client = signed_in(found.people[role])
    assert client.get(url_of(found)).status_code == 403
    assert client.post(url_of(found), {"act": "admit", "reason": "mine"}).status_code == 403
    assert found.device("ph_1").state == "candidate"


def test_a_superuser_without_the_role_may_not_admit(found: Bench) -> None:
    user = a_user("admin", on=found.node("lab"), name="operator")
    Grant.objects.filter(user=user).delete()
    client = signed_in(user)
    assert client.get(url_of(found)).status_code == 403
    assert client.post(url_of(found), {"act": "admit", "reason": "mine"}).status_code == 403
    assert found.device("ph_1").state == "candidate"


def test_a_stranger_is_sent_to_sign_in_and_back(found: Bench) -> None:
    answer = Client().get(url_of(found), follow=True)
    where, status = answer.redirect_chain[-1]
    assert status == 302
    assert where.startswith("/login?next=")
    assert str(found.device("ph_1").id) in where


def test_the_form_is_protected_against_forgery(found: Bench) -> None:
    client = Client(enforce_csrf_checks=True)
    client.force_login(found.people["admin"])
    assert client.post(url_of(found), {"act": "admit", "reason": "forged"}).status_code == 403
    assert found.device("ph_1").state == "candidate"


def test_a_device_that_is_not_there_is_not_found(found: Bench, admin: Client) -> None:
    absent = "/admin/enrollment/device/00000000-0000-0000-0000-000000000000/review/"
    assert admin.get(absent).status_code == 404


def test_hostile_text_of_a_device_stays_text(found: Bench, admin: Client) -> None:
    device = found.device("ph_1")
    device.name, device.config = "<script>alert(1)</script>", {"<b>": "<img src=x>"}
    device.save()
    text = admin.get(url_of(found)).content.decode()
    assert "<script>alert" not in text
    assert "<img src=x>" not in text
    assert "&lt;script&gt;" in text


def test_the_list_links_to_the_review_and_filters_by_state(found: Bench, admin: Client) -> None:
    path = "/admin/enrollment/device/"
    assert url_of(found) in admin.get(path).content.decode()
    enrolled = admin.get(f"{path}?state__exact=enrolled").content.decode()
    assert url_of(found) not in enrolled


@pytest.mark.parametrize(
    "table",
    [
        "crutd/event", "crutd/entry", "crutd/transaction", "approvals/decision", "runs/job",
        "runs/run", "runs/outbox", "runs/hostevent", "accounts/auditentry", "resources/resource",
        "enrollment/device", "enrollment/edgehost",
    ],
)  # fmt: skip
def test_facts_cannot_be_added_in_the_admin(found: Bench, admin: Client, table: str) -> None:
    assert admin.get(f"/admin/{table}/").status_code == 200
    assert admin.get(f"/admin/{table}/add/").status_code == 403
    assert admin.post(f"/admin/{table}/add/", {}).status_code == 403


def test_facts_cannot_be_changed_or_deleted_in_the_admin(found: Bench, admin: Client) -> None:
    entry = AuditEntry.objects.order_by("id")[0]
    for path in (
        f"accounts/auditentry/{entry.pk}",
        f"resources/resource/{found.node('water').pk}",
    ):
        assert admin.get(f"/admin/{path}/change/").status_code == 200
        assert admin.post(f"/admin/{path}/change/", {"name": "x"}).status_code == 403
        assert admin.post(f"/admin/{path}/delete/", {"post": "yes"}).status_code == 403


def test_a_list_stands_under_what_it_lists_and_tells_times_as_everywhere(
    found: Bench, admin: Client
) -> None:
    page = admin.get("/admin/enrollment/device/").content.decode()
    assert "<h1>Devices</h1>" in page
    assert "to view" not in page
    at = found.device("ph_1").discovered_at
    assert f"{at:%Y-%m-%d %H:%M} UTC" in page


def test_the_page_of_a_device_is_its_review(found: Bench, admin: Client) -> None:
    change = f"/admin/enrollment/device/{found.device('ph_1').pk}/change/"
    assert admin.get(change).headers["Location"] == url_of(found)
    assert admin.post(change, {"name": "x"}).headers["Location"] == url_of(found)
    assert found.device("ph_1").name != "x"
    unknown = "/admin/enrollment/device/00000000-0000-0000-0000-000000000000/change/"
    assert admin.get(unknown).status_code == 404


def test_giving_and_taking_a_role_is_written_down(found: Bench, admin: Client) -> None:
    user, water = found.people["observer"], found.node("water")
    body = {"user": str(user.pk), "role": "chemist", "resource": str(water.pk)}
    assert admin.post("/admin/accounts/grant/add/", body).status_code == 302
    grant = Grant.objects.get(user=user, role="chemist")
    assert AuditEntry.objects.get(action="grant.add").detail["resource"] == str(water.pk)
    admin.post(f"/admin/accounts/grant/{grant.pk}/delete/", {"post": "yes"})
    assert not Grant.objects.filter(pk=grant.pk).exists()
    assert AuditEntry.objects.get(action="grant.remove").actor == found.people["admin"]


def test_a_policy_with_a_rule_that_never_asks_is_refused(found: Bench, admin: Client) -> None:
    body = {"lab": str(found.lab.pk), "name": "Ask", "rule": '{"kind": "weather"}'}
    answer = admin.post("/admin/approvals/policy/add/", body)
    assert "no such rule" in answer.content.decode()
    body["rule"] = '{"kind": "temperature_at_least", "temperature_c": 80}'
    assert admin.post("/admin/approvals/policy/add/", body).status_code == 302
    assert AuditEntry.objects.get(action="policy.add").detail["name"] == "Ask"


def test_a_new_user_is_written_down_without_the_password(found: Bench, admin: Client) -> None:
    password = "correct-horse-battery"
    body = {"username": "new", "password1": password, "password2": password}
    answer = admin.post("/admin/accounts/user/add/", {**body, "usable_password": "true"})
    assert answer.status_code == 302, answer.content.decode()[-3000:]
    entry = AuditEntry.objects.get(action="user.add")
    assert entry.actor == found.people["admin"]
    assert password not in str(entry.detail)
