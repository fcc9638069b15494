"""What a hurried admin pastes into the pages of enrollment: a clear word, and nothing changed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from django.test import Client
from pytest_django import Settings

from labweb.accounts.models import AuditEntry
from labweb.common.signatures import authority
from labweb.enrollment import selectors, services
from labweb.enrollment.models import Candidate, Device, JoinRequest, JoinToken
from tests.builders import Bench, an_edge
from tests.labweb.enrollment.test_discovery import seen
from tests.labweb.enrollment.test_join_requests import a_key, a_token, ask_with, typed
from tests.labweb.web import signed_in

NUL, LONG = "looked\0at it", "x" * 5000


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


@pytest.fixture
def admin(bench: Bench) -> Client:
    return signed_in(bench.people["admin"])


def written() -> list[int]:
    rows = (AuditEntry, Device, JoinToken)
    states = Candidate.objects.exclude(state="new").count()
    return [*(row._default_manager.count() for row in rows), states]


def taking_up(bench: Bench, row: Candidate) -> dict[str, str]:
    return {
        "act": "take_up",
        "name": "Plate 2",
        "driver": bench.device("heater_1").driver.digest,
        "transport": "tcp://192.0.2.9:5000",
        "config": "{}",
        "code": selectors.code_of_candidate(row),
        "reason": "looked at it",
    }


@pytest.mark.parametrize(
    "wrong",
    [
        {"name": "Plate\0 2"},
        {"name": LONG},
        {"name": "Plate\u202e2"},
        {"transport": "tcp://192.0.2.9:5000\0"},
        {"transport": "tcp://" + LONG},
        {"label": NUL},
        {"config": '{"sensor": "a\\u0000b"}'},
        {"reason": NUL},
        {"code": NUL},
        {"code": NUL, "reason": NUL},
        {"driver": NUL},
    ],
    ids=lambda wrong: "+".join(f"{name}-{value[:6]!a}" for name, value in wrong.items()),
)
def test_what_no_record_can_hold_takes_nothing_up(
    bench: Bench, admin: Client, wrong: dict[str, str]
) -> None:
    row = seen(bench, an_edge(bench))
    before = written()
    url = f"/admin/enrollment/candidate/{row.id}/review/"
    answer = admin.post(url, {**taking_up(bench, row), **wrong})
    assert answer.status_code == 422
    if "code" not in wrong or "reason" in wrong:
        assert written() == before
    row.refresh_from_db()
    assert row.state == "new"


@pytest.mark.parametrize("act", ["quarantine", "ignore", "reject"])
def test_a_reason_that_no_record_can_hold_sets_nothing_aside(
    bench: Bench, admin: Client, act: str
) -> None:
    row = seen(bench, an_edge(bench))
    before = written()
    url = f"/admin/enrollment/candidate/{row.id}/review/"
    assert admin.post(url, {"act": act, "reason": NUL}).status_code == 422
    assert written() == before


@pytest.mark.parametrize("act", ["admit", "reject"])
@pytest.mark.parametrize("is_same", [True, False], ids=["code", "other code"])
def test_a_reason_that_no_record_can_hold_answers_no_machine(
    bench: Bench, admin: Client, act: str, is_same: bool
) -> None:
    key = a_key()
    row = services.take_request(ask_with(a_token(bench), key))
    before = written()
    url = f"/admin/enrollment/joinrequest/{row.id}/review/"
    code = typed(key) if is_same else "0000-0000-0000"
    assert admin.post(url, {"act": act, "reason": NUL, "code": code}).status_code == 422
    assert written() == before
    assert JoinRequest.objects.get().state == "waiting"


@pytest.mark.parametrize("name", ["Bench\0 9", "Bench\u202e9", "Bench\u200b9", LONG])
def test_a_name_that_nobody_can_read_makes_no_token(admin: Client, name: str) -> None:
    before = written()
    answer = admin.post("/admin/enrollment/jointoken/new/", {"name": name, "minutes": "10"})
    assert answer.status_code == 422
    assert written() == before


@pytest.mark.parametrize("minutes", ["nan", "inf", "-inf", "1e999", "0", "61", "\0", ""])
def test_a_time_that_is_none_makes_no_token(admin: Client, minutes: str) -> None:
    before = written()
    answer = admin.post("/admin/enrollment/jointoken/new/", {"name": "B", "minutes": minutes})
    assert answer.status_code == 422
    assert written() == before


def test_markup_in_what_a_device_says_of_itself_is_text(bench: Bench, admin: Client) -> None:
    said = "<script>alert(1)</script>"
    row = seen(bench, an_edge(bench), name=said, serial="<b>1</b>", model="\"'><i>")
    for url in ("candidate/", f"candidate/{row.id}/review/"):
        page = admin.get(f"/admin/enrollment/{url}").content.decode()
        assert said not in page
        assert "<b>1</b>" not in page
        assert "&lt;script&gt;" in page


def test_thousands_of_strangers_fill_one_page_of_the_inbox_at_a_time(
    bench: Bench, admin: Client
) -> None:
    known = seen(bench, an_edge(bench))
    rows = [
        Candidate(
            lab=known.lab, host=known.host, mark=f"n{number}", source="network",
            address=f"tcp://10.0.{number // 250}.{number % 250}:5000", name=f"Stranger {number}",
            first_seen_at=known.first_seen_at, last_seen_at=known.last_seen_at,
        )
        for number in range(10_000)
    ]  # fmt: skip
    Candidate.objects.bulk_create(rows)
    answer = admin.get("/admin/enrollment/candidate/")
    assert answer.status_code == 200
    assert answer.content.decode().count("Stranger ") <= 200


def test_the_page_of_a_driver_shows_its_source_as_text_and_nothing_of_it_acts(
    bench: Bench, admin: Client
) -> None:
    version = bench.device("heater_1").driver
    version.sources = {"drivers.odd": 'NAME = "<script>alert(1)</script>"\nNEXT = 2\n'}
    version.approval = {"signature": "</pre><img src=x>"}
    version.save()
    answer = admin.get(f"/admin/enrollment/driverversion/{version.pk}/change/")
    assert answer.status_code == 200
    page = answer.content.decode()
    assert "<summary>drivers.odd, 2 lines</summary>" in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "<script>alert(1)" not in page
    assert "<img src=x>" not in page
    assert f'<a href="/drivers/{version.pk}">' in page


@pytest.mark.parametrize(
    ("path", "told"),
    [
        ("enrollment/candidate", "Nothing has announced itself"),
        ("enrollment/jointoken", "A new token lets one machine ask"),
        ("approvals/approvalrequest", "Nothing to approve"),
    ],
)
def test_an_empty_list_says_what_would_stand_there_and_a_search_does_not(
    admin: Client, path: str, told: str
) -> None:
    assert told in admin.get(f"/admin/{path}/").content.decode()
    assert told not in admin.get(f"/admin/{path}/?q=nothing").content.decode()
