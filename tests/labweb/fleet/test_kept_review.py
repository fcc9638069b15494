"""A review is kept as one goes, and counts for nothing before it is decided."""

from __future__ import annotations

from typing import Any

import pytest
from django.test import Client

from labweb.accounts.models import AuditEntry
from labweb.common.render import with_code
from labweb.enrollment.models import Device
from tests.builders import Bench
from tests.labweb.enrollment.driver_texts import approved, timer
from tests.labweb.fleet.test_device_review import LATER, page_of, url_of
from tests.labweb.web import signed_in


@pytest.fixture
def admin(bench: Bench) -> Client:
    Device.objects.filter(lab=bench.lab).update(state="candidate")
    return signed_in(bench.people["admin"])


def filled(client: Client, device: Device, act: str, **more: Any) -> int:  # noqa: ANN401
    body = {
        "act": act,
        "action": ["heat_to", "stop_heating"],
        "limit.heat_to.temperature_c": "80",
        "label": "RCT 0815",
        "reason": "label read",
        "seen": device.driver.digest,
        **more,
    }
    return int(client.post(url_of(device), body).status_code)


def ticks(page: str) -> set[str]:
    return {
        part.split('"')[0]
        for part in page.split('name="action" value="')[1:]
        if "checked" in part.split(">")[0]
    }


def test_what_is_filled_in_is_there_again_for_the_next_person(bench: Bench, admin: Client) -> None:
    device = bench.device("heater_1")
    assert "What you fill in is kept as you go" in page_of(admin, device)
    assert filled(admin, device, "keep") == 204
    page = page_of(admin, device)
    assert ticks(page) == {"heat_to", "stop_heating"}
    assert 'aria-label="highest temperature_c of heat_to" value="80"' in page
    assert 'name="label" value="RCT 0815"' in page
    assert ">label read</textarea>" in page
    assert f"last by {bench.people['admin'].printed_name} on" in page
    again = bench.device("heater_1")
    assert (again.state, again.admission, again.admitted_as) == ("candidate", None, {})
    assert not AuditEntry.objects.filter(action="device.admit").exists()


def test_a_refused_admission_loses_no_tick(bench: Bench, admin: Client) -> None:
    device = bench.device("heater_1")
    answer = admin.post(
        url_of(device),
        {
            "act": "admit",
            "action": ["heat_to"],
            "limit.heat_to.temperature_c": "hot",
            "reason": "r",
            "seen": device.driver.digest,
        },
    )
    page = " ".join(answer.content.decode().split())
    assert answer.status_code == 422
    assert "is no number" in page
    assert ticks(page) == {"heat_to"}
    assert 'value="hot"' in page


def test_the_decision_takes_the_label_and_forgets_the_rest(bench: Bench, admin: Client) -> None:
    device = bench.device("heater_1")
    assert filled(admin, device, "admit") == 302
    admitted = bench.device("heater_1")
    assert (admitted.state, admitted.kept_review) == ("enrolled", {})
    assert admitted.admission == {"heat_to": {"temperature_c": 80.0}, "stop_heating": {}}
    assert admitted.admitted_as["label"] == "RCT 0815"
    assert AuditEntry.objects.get(action="device.admit").detail["label"] == "RCT 0815"
    assert "<dd>RCT 0815</dd>" in page_of(admin, device)
    assert filled(admin, device, "keep") == 422, "there is nothing to decide"
    assert bench.device("heater_1").kept_review == {}


def test_ticks_for_another_version_count_for_nothing(bench: Bench, admin: Client) -> None:
    device = bench.device("timer_1")
    body = {"act": "keep", "reason": "seen", "seen": device.driver.digest}
    assert admin.post(url_of(device), body).status_code == 204
    assert ticks(page_of(admin, device)) == set()
    Device.objects.filter(pk=device.pk).update(driver=approved(bench, timer(3) + LATER))
    page = page_of(admin, bench.device("timer_1"))
    assert ticks(page) == {"wait", "wait_again"}
    assert ">seen</textarea>" in page, "what was written stays"
    late = admin.post(url_of(device), {**body, "action": ["wait"], "reason": "of the old page"})
    assert late.status_code == 422
    assert "not the one that the page showed" in late.content.decode()
    kept = bench.device("timer_1").kept_review
    assert (kept["reason"], kept["digest"]) == ("seen", body["seen"])


@pytest.mark.parametrize(
    "more",
    [
        {"action": ["explode"]},
        {"label": "x" * 201},
        {"reason": "x" * 2001},
        {"limit.heat_to.temperature_c": "9" * 21},
        {"label": "RCT\0"},
        {"reason": "label\0read"},
        {"limit.heat_to.temperature_c": "8\0"},
    ],
)
def test_what_no_review_could_be_is_refused_and_not_kept(
    bench: Bench, admin: Client, more: dict[str, Any]
) -> None:
    device = bench.device("heater_1")
    assert filled(admin, device, "keep", **more) == 422
    assert bench.device("heater_1").kept_review == {}


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_others_keep_nothing(bench: Bench, admin: Client, role: str) -> None:
    device = bench.device("heater_1")
    assert filled(signed_in(bench.people[role]), device, "keep") == 403
    assert bench.device("heater_1").kept_review == {}


def test_words_in_backticks_are_shown_as_code(bench: Bench, admin: Client) -> None:
    assert with_code("`a` < b, `c` `d") == "<code>a</code> &lt; b, <code>c</code> `d"
    assert with_code("plain") == "plain"
    assert "`" not in page_of(admin, bench.device("heater_1"))
    assert "`" not in page_of(admin, bench.device("pump_1"))
